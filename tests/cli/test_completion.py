"""Completion: what the shell asks, by its own protocol, and what it is answered."""

import os
import shutil
import subprocess
import sys

import pytest
from c3d_builder import C3D, texts, walk
from click.shell_completion import ShellComplete
from commands import run
from conftest import SAMPLES

from mocapclean.cli import cli
from mocapclean.cli.actions.completion import PROGRAM, SHELLS, VARIABLE
from mocapclean.config.presets import PRESETS
from mocapclean.detection import RULES
from mocapclean.solvers import SOLVERS

LISTING = """
import sys
from mocapclean.__main__ import main
try:
    main()
finally:
    print(*sys.modules, file=sys.stderr)
"""


def offered(*words):
    """What is offered for the last word after the other ones."""
    *arguments, incomplete = map(str, words)
    return [item.value for item in ShellComplete(cli, {}, PROGRAM, VARIABLE).get_completions(arguments, incomplete)]


def test_commands_and_options_are_offered():
    assert offered("f") == ["fill"]
    assert "--max-gap" in offered("fill", "--m")


@pytest.mark.parametrize(("command", "also"), [("fill", ["auto"]), ("plot", ["auto"])])
def test_methods_are_offered(command, also):
    assert offered(command, "--method", "") == [*SOLVERS, *also]
    assert offered("methods", "kr") == ["kriging"]
    assert offered("bench", "compare", "--methods", "") == [*SOLVERS]


def test_presets_are_offered():
    assert offered("check", "--preset", "") == [*PRESETS]


def test_keys_are_offered_section_by_section():
    first = offered("fill", "--set", "")
    assert {"passes=", "trust.", "methods.", "check.", "grades."} <= set(first)
    assert "threshold=" in offered("fill", "--method", "svt", "--set", "")
    assert offered("fill", "--set", "trust.") == [f"trust.{name}." for name in RULES]
    assert offered("fill", "--set", "trust.drift.l") == ["trust.drift.least="]
    assert "methods.kriging.passes=" in offered("fill", "--set", "methods.kriging.")
    assert "check.missing=" in offered("check", "--set", "check.m")
    assert offered("fill", "--set", "nothing.of.it") == []


def test_markers_of_the_given_take_are_offered():
    assert {"LANK", "LFHD"} <= set(offered("fill", SAMPLES / "walk.c3d", "--markers", "L"))
    assert offered("plot", SAMPLES / "walk.c3d", "--marker", "STR") == ["STRN"]
    assert "Spine1" in offered("inspect", SAMPLES / "walk.bvh", "--exclude", "Sp")
    assert offered("inspect", SAMPLES / "walk_01.amc", "--exclude", "lrad") == ["lradius"]
    assert offered("fill", "nowhere.c3d", "--markers", "") == []
    assert offered("fill", SAMPLES, "--markers", "") == []


def test_a_subject_is_left_out_until_a_colon_is_typed(tmp_path):
    path = tmp_path / "take.c3d"
    labels = texts("POINT", "LABELS", ["Ann:LASI", "Ann:RASI", "Ann:SACR", "Bob:LASI", "Bob:RASI"])
    path.write_bytes(C3D(walk(), extra={"LABELS": labels}).build())
    assert offered("fill", path, "--markers", "") == ["LASI", "RASI", "SACR"]
    assert offered("fill", path, "--markers", "Ann:") == ["Ann:LASI", "Ann:RASI", "Ann:SACR"]


def test_a_broken_take_offers_nothing(tmp_path):
    path = tmp_path / "take.c3d"
    path.write_bytes(b"no take")
    assert offered("fill", path, "--markers", "") == []


def asked(shell, line, place):
    """The answer of the command, in a process of its own, to a shell that completes a line."""
    environment = {**os.environ, VARIABLE: f"{shell}_complete", "COMP_WORDS": line, "COMP_CWORD": str(place)}
    done = subprocess.run([sys.executable, "-c", LISTING], env=environment, capture_output=True, text=True, check=False)
    return done.stdout.split(), done.stderr.split()


def test_the_protocol_is_answered_without_what_works_on_takes():
    answers, modules = asked("bash", f"mocapclean fill {SAMPLES / 'walk.c3d'} --markers LFH", 4)
    assert answers == ["plain,LFHD"]
    assert not {"scipy", "pydantic", "ruamel", "mocapclean.pipeline", "mocapclean.solvers.kriging"} & set(modules)
    answers, modules = asked("bash", "mocapclean fill --me", 2)
    assert answers == ["plain,--method", "plain,--memory"]
    assert "numpy" not in modules


@pytest.mark.parametrize("shell", SHELLS)
def test_the_script_of_every_shell_is_printed(shell):
    code, out, _ = run("completion", shell)
    assert code == 0
    assert VARIABLE in out
    assert f"{shell}_complete" in out


def test_another_shell_is_refused():
    assert run("completion", "tcsh")[0] == 2


@pytest.fixture
def in_shell(tmp_path):
    """Run a script in a shell that finds the command; return the lines that it prints."""
    command = tmp_path / PROGRAM
    command.write_text(f'#!/bin/sh\nexec {sys.executable} -m mocapclean "$@"\n', encoding="utf-8")
    command.chmod(0o755)
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}", "HOME": str(tmp_path)}

    def lines(shell, options, script):
        found = shutil.which(shell)
        if found is None:
            pytest.skip(f"{shell} is not installed")
        done = subprocess.run(
            [found, *options, "-c", script], env=environment, capture_output=True, text=True, timeout=60, check=True
        )
        assert not done.stderr
        return done.stdout.splitlines()

    return lines


def in_bash(in_shell, *words):
    """What bash completes for the last word."""
    quoted = " ".join(f"'{word}'" for word in words)
    script = f"""
        eval "$(mocapclean completion bash)"
        compopt() {{ echo "compopt $1 $2"; }}
        COMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}
        _mocapclean_completion mocapclean
        printf '%s\\n' "${{COMPREPLY[@]}}"
        complete -p mocapclean
    """
    *answers, registered = in_shell("bash", ["--norc"], script)
    assert "_mocapclean_completion" in registered
    return answers


def test_bash_completes(in_shell):
    assert in_bash(in_shell, "mocapclean", "fill", "--method", "kr") == ["kriging"]
    answers = in_bash(in_shell, "mocapclean", "fill", "--set", "trust.drift.le")
    assert answers == ["compopt -o nospace", "trust.drift.least="]


def test_bash_escapes_spaces_in_names(in_shell, tmp_path):
    path = tmp_path / "take.c3d"
    labels = texts("POINT", "LABELS", ["Left Knee", "RASI", "SACR", "LASI", "C7"])
    path.write_bytes(C3D(walk(), extra={"LABELS": labels}).build())
    assert in_bash(in_shell, "mocapclean", "fill", path, "--markers", "Lef") == [r"Left\ Knee"]


def test_fish_completes_with_whole_descriptions(in_shell):
    script = (
        'mocapclean completion fish | source; complete -C "mocapclean fill --method kr"; complete -C "mocapclean ins"'
    )
    assert in_shell("fish", ["--no-config"], script) == ["kriging", f"inspect\t{cli.summaries['inspect']}"]


def test_zsh_completes(in_shell):
    script = """
        compdef() { true }
        compadd() { print -rl -- "${(P)@[-1]}" }
        eval "$(mocapclean completion zsh)"
        words=(mocapclean fill --method kr); CURRENT=4
        _mocapclean_completion
    """
    assert in_shell("zsh", ["-f"], script) == ["kriging"]


def test_the_help_has_a_recipe_for_every_shell():
    help_text = run("completion", "--help")[1]
    for shell in SHELLS:
        assert f"mocapclean completion {shell}" in help_text
