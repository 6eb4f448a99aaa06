"""The bar of a single take: on a terminal, from the first moment on; in a pipe and with --quiet nothing."""

import os
import re
import select
import subprocess
import sys
from io import StringIO
from time import monotonic

import pytest

from tests.conftest import SAMPLES

pty = pytest.importorskip("pty", reason="this system has no pseudo-terminals")


def on_terminal(*arguments):
    """The command's standard output, and what it draws on the terminal that is its standard error, piece by piece."""
    screen, terminal = pty.openpty()
    command = [sys.executable, "-m", "mocapclean", *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=terminal)
    os.close(terminal)
    pieces, last = [], monotonic() + 120
    while monotonic() < last:
        readable, _, _ = select.select([screen], [], [], 1.0)
        try:
            piece = os.read(screen, 65536) if readable else b""
        except OSError:  # the other end is closed
            break
        if piece:
            pieces.append(piece.decode())
        elif process.poll() is not None:
            break
    os.close(screen)
    printed = process.communicate()[0].decode()
    assert process.returncode == 0
    return printed, pieces


def stages(pieces):
    """The names of the stages that were drawn, each once, without the counts and the time."""
    drawn = (re.sub(r"(gap \d+ of \d+.*|\d+:\d+)$", "", part.strip()).strip() for part in "".join(pieces).split("\r"))
    return list(dict.fromkeys(name for name in drawn if name))


def test_a_fill_shows_its_stages_and_takes_them_off_again(tmp_path):
    printed, pieces = on_terminal(
        "fill", SAMPLES / "walk.c3d", "-o", tmp_path / "o.c3d", "--method", "linear", "--self-check"
    )
    shown = stages(pieces)
    assert shown[:3] == ["starting", "reading", "detecting"]
    assert shown[-3:] == ["filling", "self-check", "writing"]
    assert "self-check" in shown
    assert "".join(pieces).split("\r")[-2].strip() == ""
    assert printed.startswith(str(SAMPLES / "walk.c3d"))


def test_the_first_sign_comes_before_the_libraries_of_the_work(tmp_path):
    script = (
        "import sys; from mocapclean import progress; from mocapclean.cli import stages\n"
        "draw = stages._StageBar.stage\n"
        "def spy(bar, name, total):\n"
        "    draw(bar, name, total)\n"
        "    if name == 'starting':\n"
        "        print('numpy' in sys.modules, flush=True)\n"
        "        raise SystemExit\n"
        "stages._StageBar.stage = spy\n"
        "sys.stderr.isatty = lambda: True\n"
        "stages.drawn_bar = lambda **options: open('/dev/null')\n"
        "from mocapclean.cli import cli\n"
        "cli(['inspect', 'absent.c3d'])\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_counted_steps_are_shown_as_gaps(monkeypatch):
    from mocapclean.cli import stages as module

    made = []
    monkeypatch.setattr(module, "drawn_bar", lambda **options: made.append(options) or StringIO())
    bar = module._StageBar()
    bar.stage("filling", 451)
    bar.stage("writing", 0)
    bar.finish()
    assert [options["desc"] for options in made] == ["filling", "writing"]
    assert made[0]["bar_format"].startswith("{desc} gap {n_fmt} of {total_fmt}")
    assert (made[0]["total"], made[1]["total"]) == (451, None)


@pytest.mark.parametrize("quiet", [("--quiet",), ("--config", "quiet.yaml")])
def test_quiet_shows_nothing_once_it_is_known(tmp_path, monkeypatch, quiet):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "quiet.yaml").write_text("quiet: true\n", encoding="utf-8")
    _, pieces = on_terminal(
        "fill", SAMPLES / "walk.c3d", "-o", "o.c3d", "--method", "linear", "--no-self-check", *quiet
    )
    assert stages(pieces) == ([] if quiet == ("--quiet",) else ["starting"])


def test_a_pipe_gets_nothing(tmp_path):
    command = [sys.executable, "-m", "mocapclean", "inspect", str(SAMPLES / "walk.c3d"), "--no-detect"]
    assert subprocess.run(command, capture_output=True, check=True).stderr == b""


def test_several_takes_have_their_bar_over_takes_alone():
    _, pieces = on_terminal("check", SAMPLES / "walk.c3d", SAMPLES / "walk_truth.c3d", "--no-detect")
    text = "".join(pieces)
    assert "2/2" in text
    assert "reading" not in text
