"""What only Unix has is not needed: commands run where it is taken away, and write files as Windows allows it.

``windows_site/sitecustomize.py`` takes it away in each process of a command. No Windows is needed for that, and the
tests do not stand for one: shell, console and file system are those of this machine.
"""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest
from small_takes import store

import mocapclean
from mocapclean import files
from mocapclean.errors import FormatError, UsageError

TESTS = Path(__file__).resolve().parent
PACKAGE = Path(mocapclean.__file__).parent
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="it takes away what Linux has")


def python(*arguments, cwd=None):
    """Run Python, with what Unix alone has taken away."""
    folders = [str(TESTS / "windows_site"), str(PACKAGE.parent)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(folders), "PYTHONWARNINGS": "ignore:only soft file lock"}
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=cwd)


def mocap(*arguments):
    return python("-m", "mocapclean", *arguments)


@pytest.fixture
def takes(tmp_path):
    return store(tmp_path / "takes", "one.c3d", "two.c3d")


TAKEN_AWAY = """
import os, signal, sys, multiprocessing
assert not any(hasattr(os, name) for name in ("fork", "sched_getaffinity"))
assert not hasattr(signal, "SIGHUP")
assert multiprocessing.get_all_start_methods() == ["spawn"]
def fails(kind, call):
    try:
        call()
    except kind:
        return True
for name in ("fcntl", "resource"):
    assert fails(ImportError, lambda: __import__(name)), name
assert fails(FileNotFoundError, lambda: open("/proc/self/statm"))
assert fails(ValueError, lambda: signal.signal(signal.SIGPIPE, signal.SIG_IGN))
with open("held", "w") as held, open("other", "w"):
    assert fails(PermissionError, lambda: os.replace("other", "held"))
    assert fails(PermissionError, lambda: os.unlink("held"))
with open("held") as held:
    assert fails(OSError, lambda: os.fsync(held.fileno()))
"""


def test_the_site_takes_away_what_it_says(tmp_path):
    done = python("-c", TAKEN_AWAY, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


IN_PYTHON = """
import sys, mocapclean
from mocapclean.cores import in_parts, sharing
if __name__ == "__main__":
    take = mocapclean.detect(mocapclean.read("one.c3d"))
    mocapclean.write(mocapclean.fill(take).take, "python.c3d")
    with sharing(2):
        assert list(in_parts(abs, range(-30, 0))) == list(range(30, 0, -1))
"""


def test_a_take_is_read_filled_and_written_in_python(takes):
    done = python("-c", IN_PYTHON, cwd=takes)
    assert done.returncode == 0, done.stderr
    result = mocapclean.fill(mocapclean.detect(mocapclean.read(takes / "one.c3d")))
    mocapclean.write(result.take, takes / "here.c3d")
    assert (takes / "python.c3d").read_bytes() == (takes / "here.c3d").read_bytes()


def test_a_batch_replaces_existing_files_and_is_resumed(takes, tmp_path):
    batch = ["fill", takes, "--out-dir", tmp_path / "out", "--sidecar", tmp_path / "arrays", "--method", "linear"]
    store(tmp_path / "out", "one.c3d", "two.c3d")
    done = mocap(*batch, "--workers", "2", "--overwrite")
    assert (done.returncode, done.stderr) == (0, "")
    assert "2 takes: 2 repaired" in done.stdout
    done = mocap(*batch, "--workers", "1", "--resume")
    assert "2 done before" in done.stdout, done.stderr
    assert not list(tmp_path.rglob("*.part*"))
    for name in ("one.c3d", "two.c3d"):
        result = mocapclean.fill(mocapclean.detect(mocapclean.read(takes / name)), "linear")
        mocapclean.write(result.take, tmp_path / name)
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / name).read_bytes()


def test_a_limit_of_memory_is_refused_in_one_line(takes, tmp_path):
    done = mocap("fill", takes, "--out-dir", tmp_path / "out", "--memory", "1GiB")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "this system cannot limit the memory of a process" in done.stderr


@pytest.mark.parametrize(
    "name", ["nul.c3d", "CON", "com1.tar.gz", "Lpt¹.c3d", "aux .c3d", "take.c3d:hidden", "take.c3d.", "take "]
)
def test_a_name_that_windows_keeps_no_file_of_is_refused_there(tmp_path, monkeypatch, name):
    files.check_output(tmp_path / name, None, overwrite=False)
    monkeypatch.setattr(files, "_on_windows", True)
    with pytest.raises(UsageError, match="Windows keeps no file of this name"):
        files.check_output(tmp_path / name, None, overwrite=False)
    files.check_output(tmp_path / "console.c3d", None, overwrite=False)


def test_what_is_peculiar_to_windows_is_said_there(tmp_path, monkeypatch):
    def refused(path):
        with pytest.raises(FormatError) as error, files.new_file(path):
            raise PermissionError(13, "Access is denied")
        return str(error.value)

    assert refused(tmp_path / "take.c3d").endswith("cannot be written: Access is denied.")
    monkeypatch.setattr(files, "_on_windows", True)
    assert refused(tmp_path / "take.c3d").endswith("Close the program that has it open.")
    deep = tmp_path / ("d" * 120) / ("e" * 120)
    deep.mkdir(parents=True)
    assert "has more than 259 characters" in refused(deep / "take.c3d")


def test_names_are_printed_where_the_encoding_has_not_all_letters(takes):
    (takes / "one.c3d").rename(takes / "Läufer √.c3d")
    environment = {**os.environ, "PYTHONIOENCODING": "cp1252", "PYTHONPATH": str(PACKAGE.parent)}
    command = [sys.executable, "-m", "mocapclean", "inspect", str(takes / "Läufer √.c3d")]
    done = subprocess.run(command, capture_output=True, env=environment, check=True)
    assert "Läufer \\u221a.c3d" in done.stdout.decode("cp1252")


def text_calls(path):
    """Yield the calls in a module that open text: line, mode, and the names of the arguments that are given."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        function = node.func
        name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
        given = {keyword.arg for keyword in node.keywords}
        if name in ("read_text", "write_text"):
            yield node.lineno, name[0], given
        elif name == "open" and not (isinstance(function, ast.Attribute) and getattr(function.value, "id", "") == "os"):
            arguments = node.args if isinstance(function, ast.Attribute) else node.args[1:]
            mode = arguments[0].value if arguments and isinstance(arguments[0], ast.Constant) else "r"
            if "b" not in mode and isinstance(getattr(arguments[0], "value", "") if arguments else "", str):
                yield node.lineno, mode, given


def test_text_has_an_encoding_and_its_line_ends_stay():
    n_calls = 0
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE).as_posix()
        for line, mode, given in text_calls(path):
            n_calls += 1
            if place == "dictionaries/dictionary.py" and mode == "r":
                continue  # the entry of an archive, which is no text
            assert "encoding" in given, f"{place}:{line} takes the encoding of the system"
            assert mode[0] == "r" or "newline" in given, f"{place}:{line} takes the line ends of the system"
    assert n_calls > 15
