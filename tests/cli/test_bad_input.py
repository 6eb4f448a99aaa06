"""Bad input through the commands: one sentence, the right exit code, nothing lost."""

import os
import resource
import signal
import time
from pathlib import Path

import pytest

from tests.commands import files_in, launch, run

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"

USAGE = [
    ("no input", (), "Missing argument"),
    ("unknown method", ("{walk}", "--method", "magic"), "method must be"),
    ("unknown parameter", ("{walk}", "--set", "foo=1"), "unknown key 'methods.kriging.foo'"),
    ("output is the input", ("{walk}", "-o", "{walk}", "--overwrite"), "must not be the input"),
    ("output exists", ("{walk}", "-o", "{truth}"), "exists already"),
    ("another format", ("{walk}", "-o", "x.bvh"), "must have the input's format, .c3d"),
    ("two inputs, one output", ("{walk}", "{truth}", "-o", "x.c3d"), "--output takes one input"),
    ("one name twice", ("{walk}", "{walk}"), "two results would have this name"),
    ("report over the input", ("{walk}", "--report", "{walk}", "--overwrite"), "must not be the input"),
    (
        "report over the reference",
        ("{walk}", "--reference", "{truth}", "--report", "{truth}", "--overwrite"),
        "must not",
    ),
    ("a folder", ("{folder}",), "an input folder needs --out-dir"),
    ("unknown marker", ("{walk}", "--markers", "LELBO"), "LELB"),
    ("everything excluded", ("{walk}", "--exclude", "*"), "must leave at least one marker"),
    ("no error bars", ("{walk}", "--method", "spline", "--max-error", "9"), "that gives error bars: kriging"),
    (
        "no error bars as it is set",
        ("{walk}", "--method", "dynammo", "--set", "em=imputed", "--set", "max_iterations=2", "--max-error", "9"),
        "dynammo gives none as it is set",
    ),
    ("a sidecar of another kind", ("{walk}", "--sidecar", "x.mat"), "--sidecar must be an .npz file, or a folder"),
    ("bad limit", ("{walk}", "--max-left", "many"), "max_left must be"),
    ("bad rate", ("{walk}", "--rate", "-5"), "rate must be greater than 0"),
    ("config that is not there", ("{walk}", "--config", "none.yaml"), "cannot be read"),
    ("skeleton of no kind", ("{walk}", "--skeleton", "{truth}"), "must be an .asf or a .bvh"),
]


@pytest.mark.parametrize(("what", "arguments", "message"), USAGE, ids=[row[0] for row in USAGE])
def test_wrong_usage_exits_2_and_writes_nothing(folder, what, arguments, message):
    names = {
        "walk": folder / "walk.c3d",
        "truth": folder / "walk_truth.c3d",
        "folder": folder,
    }
    before = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    code, _out, err = run("fill", *(argument.format(**names) for argument in arguments))
    assert code == 2, err
    assert message in err
    assert "Traceback" not in err
    assert {path: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before


BAD_FILES = [
    ("empty.c3d", b"", "is empty"),
    ("text.c3d", b"marker,x,y,z\nLASI,1,2,3\n" * 50, "not C3D"),
    ("none.c3d", None, "none.c3d: the file must exist. It does not."),
    ("take.xyz", b"1", "must end in one of .c3d"),
    ("walk.asf", (SAMPLES / "walk.asf").read_bytes(), "a skeleton, not a take"),
    ("lonely.amc", (SAMPLES / "walk_01.amc").read_bytes(), ".asf"),
    ("text.bvh", b"hello\n" * 10, "BVH"),
    ("noise.bvh", bytes(range(256)) * 4, "BVH"),
]


@pytest.mark.parametrize(("name", "content", "message"), BAD_FILES, ids=[row[0] for row in BAD_FILES])
def test_bad_files_exit_1_with_one_sentence(tmp_path, name, content, message):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    code, _out, err = run("fill", path, "--method", "linear")
    assert code == 1
    assert len(err.strip().splitlines()) == 1
    assert message in err
    assert name in err
    assert {p.name for p in tmp_path.iterdir()} <= {name}


def test_a_folder_that_cannot_be_written(folder):
    if os.geteuid() == 0:
        pytest.skip("the superuser can write everywhere")
    folder.chmod(0o555)
    try:
        code, _, err = run("fill", folder / "walk.c3d", "--method", "linear")
    finally:
        folder.chmod(0o755)
    assert code == 1
    assert "cannot be written" in err


def test_an_output_in_a_folder_that_is_not_there(folder):
    code, _, err = run("fill", folder / "walk.c3d", "--method", "linear", "-o", folder / "none" / "out.c3d")
    assert code == 1
    assert "out.c3d: cannot be written: its folder does not exist" in err


def test_an_output_folder_that_is_a_file(folder):
    code, _, err = run("fill", folder / "walk.c3d", "--out-dir", folder / "walk.bvh")
    assert code == 2
    assert "the folder cannot be made" in err


def test_a_full_disk_leaves_nothing_behind(folder):
    before = files_in(folder)
    limit = len(before["walk.c3d"]) // 2
    process = launch(
        "fill",
        folder / "walk.c3d",
        "--method",
        "linear",
        preexec_fn=lambda: (
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN),
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        ),
    )
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "cannot be written: File too large" in err
    assert "Traceback" not in err
    assert files_in(folder) == before


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGKILL, -9)])
def test_stopped_in_the_middle_leaves_no_half_file(folder, number, code):
    before = files_in(folder)
    process = launch(
        "fill", folder / "walk.c3d", "--method", "ialm", "--set", "tolerance=0", "--set", "max_iterations=1000000"
    )
    time.sleep(4)
    assert process.poll() is None, process.communicate()
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == code
    assert "Traceback" not in err
    assert files_in(folder) == before
