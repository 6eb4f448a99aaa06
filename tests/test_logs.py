"""The logger: quiet by default, one line for each step with ``-v``, and records with values for a program."""

import logging
import os
import re
import shlex
import subprocess
import sys

import pytest
from click.testing import CliRunner

import mocapclean
from mocapclean import logs
from mocapclean.cli import cli
from tests.conftest import SAMPLES

STEPS = ["read", "detected", "detected", "method", "filled", "accepted", "written", "repaired"]


def run(*arguments):
    return CliRunner().invoke(cli, list(map(str, arguments)))


def values(line):
    """The values of a line by key."""
    return dict(word.split("=", 1) for word in shlex.split(line))


@pytest.fixture
def take(tmp_path):
    path = tmp_path / "a small take.c3d"
    mocapclean.write(mocapclean.read(SAMPLES / "walk.c3d").crop(0, 60), path)
    return path


def fill(take, *options):
    output = take.with_name("out.c3d")
    return run("fill", take, "-o", output, "--overwrite", "--method", "linear", "--no-self-check", *options)


def test_nothing_is_logged_unless_asked_for(take):
    assert fill(take).stderr == ""
    assert fill(take, "-v").stderr
    assert fill(take).stderr == ""


def test_each_step_is_a_line_with_its_values(take):
    done = fill(take, "-v")
    lines = [values(line) for line in done.stderr.splitlines()]
    assert [line["event"] for line in lines] == STEPS
    assert {line["take"] for line in lines} == {str(take)}
    assert {line["level"] for line in lines} == {"info"}
    assert {line["process"] for line in lines} == {str(os.getpid())}
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}", line["time"]) for line in lines)
    read, filled = lines[0], next(line for line in lines if line["event"] == "filled")
    assert (read["frames"], read["markers"], read["rate"]) == ("60", "40", "120")
    assert filled["method"] == "linear"
    assert float(filled["seconds"]) >= 0.0
    assert "gap" in done.stdout  # -v also prints every gap


def test_details_are_logged_where_they_are_asked_for(take):
    events = [values(line)["event"] for line in fill(take, "-vv").stderr.splitlines()]
    assert {"stage", "finding", "parameters"} <= {*events}
    assert [event for event in events if event in STEPS] == STEPS


def test_a_take_that_fails_is_logged(tmp_path):
    (tmp_path / "bad.c3d").write_bytes(b"nothing")
    lines = [line for line in fill(tmp_path / "bad.c3d", "-v").stderr.splitlines() if line.startswith("time=")]
    assert [values(line)["event"] for line in lines] == ["failed"]
    assert "bad.c3d" in values(lines[0])["error"]


def test_worker_processes_log_too(take, tmp_path):
    command = [
        sys.executable,
        "-m",
        "mocapclean",
        "fill",
        tmp_path,
        "--out-dir",
        tmp_path / "out",
        "-v",
        "--timeout",
        "60",
    ]
    command += ["--method", "linear", "--no-self-check", "--no-detect"]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=True)
    lines = [values(line) for line in done.stderr.splitlines()]
    assert [line["event"] for line in lines] == STEPS
    assert str(os.getpid()) not in {line["process"] for line in lines}


@pytest.mark.parametrize("name", sorted({*cli.list_commands(None)} - {"config", "completion", "man"}))
def test_every_command_that_reads_or_writes_takes_has_the_option(name):
    assert re.search(r"-v, --verbose.*-vv", " ".join(run(name, "--help").stdout.split()))


def test_a_program_gets_records_with_values(caplog, take):
    with caplog.at_level(logging.INFO, logger=logs.NAME):
        mocapclean.fill(mocapclean.read(take), "linear", self_check=False)
    assert [record.event for record in caplog.records] == ["read", "detected", "method", "filled", "accepted"]
    assert {record.name for record in caplog.records} == {"mocapclean"}
    read = caplog.records[0]
    assert read.values["frames"] == 60
    assert read.getMessage().startswith(f'event=read file="{take}" format=c3d frames=60')


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("", '""'),
        ("a b", '"a b"'),
        ('say "x"', '"say \\"x\\""'),
        ("a=b", '"a=b"'),
        ("x\ny", '"x\\ny"'),
        (True, "true"),
        (0.5, "0.5"),
    ],
)
def test_a_value_is_one_word_or_is_quoted(caplog, value, text):
    with caplog.at_level(logging.INFO, logger=logs.NAME):
        logs.event("tried", name=value, absent=None)
    assert caplog.messages == [f"event=tried name={text}"]


def test_without_the_module_logging_nothing_is_loaded_or_said():
    code = "import sys; from mocapclean import logs; logs.event('read'); assert 'logging' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stderr == b""


def test_a_program_that_sets_nothing_up_sees_nothing():
    code = (
        "import logging; from mocapclean import logs; logs.event('read'); logging.getLogger('mocapclean').warning('x')"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stderr == b""
