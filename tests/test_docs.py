"""The documents agree with the code: their examples run, and their tables and defaults are complete and true."""

import importlib
import json
import os
import re
import shlex
import shutil
import subprocess
from dataclasses import fields
from pathlib import Path

import pytest
from click.testing import CliRunner
from ruamel.yaml import YAML

from mocapclean.batch.inputs import Input
from mocapclean.batch.plan import plan
from mocapclean.cli import cli
from mocapclean.config.loading import resolve
from mocapclean.config.settings import Methods, Settings
from mocapclean.detection import RULES
from mocapclean.errors import ConfigError
from mocapclean.json_values import plain
from mocapclean.parameters import annotations
from mocapclean.solvers import SOLVERS
from mocapclean.take.status import MEANINGS, Status

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(path, language):
    return re.findall(rf"```{language}\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL)


def test_python_in_the_readme_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    (code,) = blocks(ROOT / "README.md", "python")
    exec(compile(code, "README.md", "exec"), {})
    assert (tmp_path / "walk_clean.c3d").exists()


@pytest.mark.parametrize(
    "name", ["README.md", *sorted(f"docs/howto/{p.name}" for p in (ROOT / "docs/howto").glob("*.md"))]
)
def test_commands_that_can_be_copied_are_understood(name):
    lines = [line for block in blocks(ROOT / name, "sh") for line in block.splitlines()]
    commands = [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("mocapclean ")]
    assert commands
    for name, *arguments in commands:
        command = cli.get_command(None, name)
        command.make_context(name, [a.replace("*", "take") for a in arguments])


def test_every_key_has_a_documented_example(tmp_path):
    (text,) = blocks(ROOT / "docs" / "configuration.md", "yaml")
    path = tmp_path / "studio.yaml"
    path.write_text(text, encoding="utf-8")
    resolve(path, {})
    keys = YAML(typ="safe").load(text)
    assert set(keys) == set(annotations(Settings))
    assert set(keys["trust"]) == set(RULES)
    assert set(keys["methods"]) == set(SOLVERS)
    for name, module in RULES.items():
        section = re.split(r"\n {0,2}\w", text.split("\ntrust:", 1)[1].split(f"\n  {name}:", 1)[1])[0]
        for field in fields(module.Params):
            assert f"\n    {field.name}:" in section, f"trust.{name}.{field.name}"
    for name, module in SOLVERS.items():
        section = text.split(f"\n  {name}:", 1)[1]
        for field in fields(module.Params):
            assert f"\n    {field.name}:" in section, f"{name}.{field.name}"


def leaves(section, default, path=()):
    """Yield (path, line from 0, documented value, default) of every value in a section of a YAML document."""
    for key, value in section.items():
        if isinstance(value, dict) and default[key]:
            yield from leaves(value, default[key], (*path, key))
        else:
            yield ".".join((*path, key)), section.lc.key(key)[0], value, default[key]


def test_documented_values_are_the_defaults_unless_marked_as_examples():
    (text,) = blocks(ROOT / "docs" / "configuration.md", "yaml")
    default = Settings(methods=Methods({name: module.Params() for name, module in SOLVERS.items()})).as_json()
    values = list(leaves(YAML(typ="rt").load(text), default))
    assert len(values) > 200
    for name, line, value, expected in values:
        is_example = "# example; " in text.splitlines()[line]
        assert (value != expected) == is_example, f"{name} is {value!r} in the document, its default is {expected!r}"


def comment(text, key):
    """The words in the comment of a key of configuration.md."""
    return set(re.findall(r"[a-z0-9]+", re.search(rf"^{key}: .*?# (.*)$", text, re.MULTILINE)[1]))


def accepts_max_error(method):
    try:
        resolve(None, {"method": method, "max_error": 5.0})
    except ConfigError:
        return False
    return True


def test_documented_methods_are_those_of_the_code():
    (text,) = blocks(ROOT / "docs" / "configuration.md", "yaml")
    assert comment(text, "max_error") & {*SOLVERS} == {name for name in SOLVERS if accepts_max_error(name)}
    assert comment(text, "self_check") & {*SOLVERS} == {name for name in SOLVERS if Settings(method=name).checks_itself}


def test_the_methods_with_error_bars_are_those_of_the_code():
    text = (ROOT / "docs" / "report.md").read_text(encoding="utf-8")
    (sentence,) = re.findall(r"error bars; (`.*?) give them", text)
    assert set(re.findall(r"`(\w+)`", sentence)) == {
        name for name, module in SOLVERS.items() if module.TRAITS.error_bars
    }


def test_the_candidates_of_auto_are_those_of_the_code():
    text = (ROOT / "docs" / "methods.md").read_text(encoding="utf-8")
    (sentence,) = re.findall(r"`auto.methods` \(by default (.*?)\)", text, re.DOTALL)
    assert tuple(re.findall(r"`(\w+)`", sentence)) == Settings().auto.methods


@pytest.mark.parametrize("name", ["README", "methods", "configuration", "trust", "changes", "check", "report", "batch"])
def test_assignments_are_keys_of_the_configuration(name):
    document = ROOT / "README.md" if name == "README" else ROOT / "docs" / f"{name}.md"
    for key, value in re.findall(r"--set\s+([\w.]+)=([^\s`)]+)", document.read_text(encoding="utf-8")):
        resolve(None, {}, [f"{key}={value}"])


def documented_limits():
    text = (ROOT / "docs" / "check.md").read_text(encoding="utf-8")
    return re.search(r"## Limits.*?```yaml\n(.*?)```", text, re.DOTALL)[1]


def test_limits_without_a_default_are_the_documented_ones():
    default = plain(Settings().check)
    documented = YAML(typ="rt").load(documented_limits())["check"]
    for name, value in documented.items():
        is_default = "# default; " in documented_limits().splitlines()[documented.lc.key(name)[0]]
        assert (value == default[name]) == is_default, name


def test_nothing_is_installed_from_an_index():
    for document in DOCUMENTS:
        for target in re.findall(r"pip install ([^&`\n]*)", document.read_text(encoding="utf-8")):
            assert re.search(r"(^|[ '])\.", target), f"{document.name}: pip install {target}"


def written_by(command):
    """The files that a command of README's set-up writes into the clone, without running it."""
    program, *arguments = shlex.split(command)
    program = Path(program).name
    if arguments[:2] == ["-m", "venv"]:
        return [f"{arguments[2]}/bin/python"]
    if program == "pip":
        return ["build/lib/mocapclean/take.py", "mocapclean.egg-info/PKG-INFO"]
    if arguments[:2] == ["-m", "pytest"]:
        return [".pytest_cache/README.md", ".hypothesis/examples", "tests/__pycache__/test_docs.pyc"]
    assert program == "mocapclean", command
    name, *arguments = arguments
    options = cli.get_command(None, name).make_context(name, arguments).params
    (source,) = options["files"]
    (job,) = plan(
        [Input(path=source, relative=Path(source.name))],
        Settings(output=options["output"], html=options["html"], overwrite=True),
        [],
        {},
    )
    return [str(target) for target in (*job.targets, options["html"])]


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
def test_git_ignores_what_the_set_up_writes(tmp_path):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (set_up,) = re.findall(r"<!-- set-up -->\n```sh\n(.*?)```", readme, re.DOTALL)
    written = [path for line in set_up.splitlines() for part in line.split("&&") for path in written_by(part)]
    assert {"walk_clean.c3d", "walk_clean.c3d.report.json", "walk_clean.html"} <= set(written)
    shutil.copy(ROOT / ".gitignore", tmp_path)
    git = ["git", "-C", str(tmp_path), "-c", f"core.excludesFile={os.devnull}"]
    subprocess.run([*git, "init", "-q"], check=True)
    own = ["README.md", "mocapclean/take/take.py", "sample_data/walk.c3d"]
    done = subprocess.run([*git, "check-ignore", *written, *own], capture_output=True, text=True)
    assert done.stdout.splitlines() == written


@pytest.mark.parametrize("name", SOLVERS)
def test_every_method_is_in_the_table_and_has_its_entry(name):
    text = (ROOT / "docs" / "methods.md").read_text(encoding="utf-8")
    assert f"\n| `{name}`" in text
    entry = text.split(f"## `{name}`", 1)[1].split("\n## ")[0]
    for part in ("Model", "When", "Fails", "Cost"):
        assert f"**{part}" in entry


def test_the_table_of_statuses_is_that_of_the_code():
    text = (ROOT / "docs" / "report.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| `(\w+)` \| (.*) \|$", text.split("## The status of a sample")[1].split("\n## ")[0], re.MULTILINE
    )
    assert rows == [(status.code, MEANINGS[status]) for status in Status]
    schema = json.loads((ROOT / "docs" / "report.schema.json").read_text(encoding="utf-8"))
    assert schema["$defs"]["status"]["enum"] == [status.code for status in Status]


def test_the_list_of_constants_is_that_of_the_code(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    constants = importlib.import_module("constants")
    unexplained = [f"{module} {name}" for module, name, _, meaning in constants.constants() if not meaning]
    assert not unexplained
    assert (ROOT / "docs" / "constants.md").read_text(encoding="utf-8") == constants.document(), (
        "run: python benchmarks/constants.py > docs/constants.md"
    )


def test_links_lead_somewhere():
    for document in DOCUMENTS:
        for target in re.findall(r"\]\(([^)#:]+)\)", document.read_text(encoding="utf-8")):
            assert (document.parent / target).exists(), f"{document.name}: {target}"


CALL = {"files", "config", "assignments", "no_report", "as_json", "resume"}
CALL |= {"only_missing", "files_from", "null", "relative_to", "shard"}


def test_every_option_is_a_configuration_key():
    command = cli.get_command(None, "fill")
    names = {parameter.name for parameter in command.params} - CALL
    assert names == set(annotations(Settings)) - {"methods", "trust", "check", "grades", "hiding", "auto"}


def test_every_command_has_a_whole_line_in_the_help():
    lines = CliRunner().invoke(cli, ["--help"], terminal_width=80).stdout.splitlines()
    for name, summary in cli.summaries.items():
        assert any(line.split(maxsplit=1) == [name, summary] for line in lines), name


def test_help_is_given_for_every_command():
    for name in cli.list_commands(None):
        result = CliRunner().invoke(cli, [name, "--help"])
        assert result.exit_code == 0
        assert "Usage:" in result.stdout
