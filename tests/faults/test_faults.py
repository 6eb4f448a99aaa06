"""Runs that something happens to, for real: what is written is whole, what is told is true, and no take is lost.

A named pipe stands for a file server that does not answer: whoever reads it waits.
"""

import contextlib
import ctypes
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from small_takes import assert_true, hashes, rows_of, small, store

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the tests look into /proc")

NAMES = ("a.c3d", "b.c3d", "sub/c.c3d", "sub/y.c3d", "z.c3d")
HANGS = "m.c3d"
STARTED = []


@pytest.fixture
def captures(tmp_path, monkeypatch):
    """A folder of five takes in the current folder; when the test is over they are as they were, and nobody runs."""
    monkeypatch.chdir(tmp_path)
    folder = store(Path("captures"), *NAMES)
    before = hashes(folder)
    yield folder
    for process in STARTED:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    STARTED.clear()
    assert hashes(folder) == before


@pytest.fixture
def hanging(captures):
    """The takes, and in the middle of them one that never arrives."""
    os.mkfifo(captures / HANGS)
    yield captures
    (captures / HANGS).unlink(missing_ok=True)


def start(*arguments, **options):
    """Start a run of small takes in a session of its own, one at a time, its report in all.json."""
    words = ["fill", "captures", "--out-dir", "clean", "--method", "linear", "--report", "all.json", "--workers", 1]
    words += arguments
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    STARTED.append(subprocess.Popen([sys.executable, "-m", "mocapclean", *map(str, words)], **pipes, **options))
    return STARTED[-1]


def end(process, code, pipe=None):
    """Wait for a run, whose exit code must be this; what it said on standard error. A pipe's readers get nothing."""
    while pipe and process.poll() is None:
        with contextlib.suppress(OSError):
            os.close(os.open(pipe, os.O_WRONLY | os.O_NONBLOCK))
        time.sleep(0.02)
    _, err = process.communicate(timeout=60)
    assert process.returncode == code, err
    assert "Traceback" not in err
    return err


def until(condition):
    deadline = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def workers_of(process):
    """The processes that work at takes: the forkserver's children."""
    parents = {}
    for name in filter(str.isdigit, os.listdir("/proc")):
        with contextlib.suppress(OSError):
            state, parent = Path(f"/proc/{name}/stat").read_text().rpartition(")")[2].split()[:2]
            if state != "Z":
                parents[int(name)] = int(parent)
    return [pid for pid, parent in parents.items() if parents.get(parent) == process.pid]


def stuck(process):
    """The worker that waits for the pipe."""
    for pid in workers_of(process):
        with contextlib.suppress(OSError):
            if Path(f"/proc/{pid}/wchan").read_text() == "wait_for_partner":
                return pid
    return None


def statuses(report=Path("all.json")):
    return {Path(source).name: row["status"] for source, row in rows_of(report).items()}


def outputs():
    return {name for name in hashes(Path("clean")) if not name.startswith(".mocapclean")}


def resumed():
    """Go on with a run until nothing fails; the truth about every take."""
    end(start("--resume"), 0)
    rows = rows_of(Path("all.json"))
    assert_true(rows, Path("clean"))
    assert {row["status"] for row in rows.values()} == {"repaired"}
    return rows


def test_a_worker_that_is_killed_costs_its_own_take(hanging):
    process = start("--workers", 2)
    until(lambda: outputs() == set(NAMES))
    os.kill(stuck(process), signal.SIGKILL)
    err = end(process, 1)
    assert "m.c3d: its process was killed by SIGKILL" in err
    assert statuses() == {**{Path(name).name: "repaired" for name in NAMES}, HANGS: "failed"}
    assert_true(rows_of(Path("all.json")), Path("clean"))


def test_workers_that_are_killed_again_and_again_lose_no_take(captures):
    store(captures, *NAMES, *(f"more/{number}.c3d" for number in range(20)))
    process = start("--workers", 2)
    n_killed = 0
    while process.poll() is None:
        for pid in workers_of(process)[:1]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
                n_killed += 1
        time.sleep(0.15)
    process.communicate()
    assert n_killed
    rows = rows_of(Path("all.json"))
    assert len(rows) == len(NAMES) + 20
    assert_true(rows, Path("clean"))
    resumed()
    shutil.rmtree(captures / "more")


def test_a_take_that_hangs_and_one_that_needs_too_much_memory(hanging):
    (hanging / "large.c3d").write_bytes(small(n_frames=20000, n_points=40))
    err = end(start("--workers", 2, "--timeout", 3, "--memory", "24MB"), 1)
    assert "m.c3d: it took longer than the limit of 3 s" in err
    assert "large.c3d: there is not enough memory" in err
    assert statuses() == {**{Path(name).name: "repaired" for name in NAMES}, HANGS: "failed", "large.c3d": "failed"}
    assert_true(rows_of(Path("all.json")), Path("clean"))
    (hanging / "large.c3d").unlink()


def test_the_parent_is_killed_and_the_run_resumed(hanging):
    process = start("--workers", 2)
    until(lambda: Path("clean/.mocapclean/journal.jsonl").exists())
    until(lambda: Path("clean/.mocapclean/journal.jsonl").read_text().count('{"output":') == len(NAMES))
    process.kill()
    process.wait()
    until(lambda: not workers_of(process))
    assert not Path("all.json").exists()
    first = {name: (Path("clean") / name).stat().st_ino for name in NAMES}
    (hanging / HANGS).unlink()
    rows = resumed()
    assert len(rows) == len(NAMES)
    assert {name: (Path("clean") / name).stat().st_ino for name in NAMES} == first


def test_killed_at_any_moment_a_run_can_be_resumed(captures):
    for delay in (0.0, 0.05):
        process = start("--workers", 2, *(["--resume"] if Path("clean").exists() else []))
        until(lambda: Path("clean/.mocapclean/journal.jsonl").exists())
        time.sleep(delay)
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        for name in outputs():
            if not Path(name).name.startswith("."):
                (Path("clean") / name).unlink()
                break
    resumed()
    assert not list(Path("clean").rglob("*.part*"))


def test_a_full_disk(captures):
    (captures / "large.c3d").write_bytes(small(n_frames=4000, n_points=40))
    limit = 1 << 20

    def full():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    err = end(start("--workers", 2, preexec_fn=full), 1)
    assert "large.c3d: cannot be written: File too large" in err
    assert statuses() == {**{Path(name).name: "repaired" for name in NAMES}, "large.c3d": "failed"}
    assert_true(rows_of(Path("all.json")), Path("clean"))
    assert len(resumed()) == len(NAMES) + 1
    (captures / "large.c3d").unlink()


def test_the_output_folder_is_removed_in_the_middle(hanging):
    process = start()
    until(lambda: "b.c3d" in outputs())
    shutil.rmtree("clean")
    err = end(process, 1, hanging / HANGS)
    assert "z.c3d: cannot be written: its folder does not exist" in err
    rows = statuses()
    assert (rows[HANGS], rows["z.c3d"]) == ("failed", "failed")
    assert len(rows) == len(NAMES) + 1
    assert not Path("clean").exists()


def as_anybody():
    """Give up the superuser's right to write everywhere (PR_CAPBSET_DROP, CAP_DAC_OVERRIDE)."""
    ctypes.CDLL(None).prctl(24, 1, 0, 0, 0)


def test_a_folder_that_nobody_may_write_into(captures):
    Path("clean").mkdir(mode=0o555)
    err = end(start(preexec_fn=as_anybody), 2)
    assert "the folder cannot be made: Permission denied" in err
    for folder in ("sub", ".mocapclean"):
        (Path("clean") / folder).mkdir()
    err = end(start(preexec_fn=as_anybody), 1)
    assert "clean/a.c3d: cannot be written: Permission denied" in err
    assert statuses() == {"a.c3d": "failed", "b.c3d": "failed", "z.c3d": "failed"} | dict.fromkeys(
        ("c.c3d", "y.c3d"), "repaired"
    )
    assert_true(rows_of(Path("all.json")), Path("clean"))


def test_two_runs_into_one_folder(hanging):
    first = start()
    until(lambda: "b.c3d" in outputs())
    assert "another run is writing there" in end(start("--resume"), 2)
    end(first, 1, hanging / HANGS)
    assert set(statuses().values()) == {"repaired", "failed"}


def test_an_input_that_changes_while_it_is_read_is_not_repaired(captures, monkeypatch):
    from mocapclean.batch import repairing
    from mocapclean.batch.repairing import Repair, RepairJob
    from mocapclean.config.settings import Settings

    real = repairing.repair
    old = (captures / "a.c3d").read_bytes()

    def slow(source, *others):
        source.write_bytes(small(50))
        return real(source, *others)

    monkeypatch.setattr(repairing, "repair", slow)
    done = Repair(Settings(method="linear"))(RepairJob(name="a", source=captures / "a.c3d", output=Path("out.c3d")))
    (captures / "a.c3d").write_bytes(old)
    assert done.row["status"] == "failed"
    assert "changed while it was read" in done.row["error"]
    assert (done.key, Path("out.c3d").exists()) == ("", False)


ODD = ("a b.c3d", "new\nline.c3d", "quo'te\".c3d", "-dash.c3d", "é 走る.c3d", "走" * 81 + ".c3d", "n" * 246 + ".c3d")
ODD += (
    "$(touch x).c3d",
    "back\\slash.c3d",
    "%s{0}.c3d",
    "tab\t.c3d",
    "sub folder\n/x.c3d",
    os.fsdecode(b"latin\xe9.c3d"),
)


def test_odd_names(captures):
    shutil.rmtree("captures")
    store(captures, *ODD)
    before = hashes(captures)
    end(start("--workers", 2, "--json"), 0)
    rows = rows_of(Path("all.json"))
    assert {os.path.relpath(source, "captures") for source in rows} == set(ODD)
    assert_true(rows, Path("clean"))
    listing = b"".join(os.fsencode(captures / name) + b"\0" for name in ODD)
    words = ("fill", "-0", "--files-from", "-", "--relative-to", "captures", "--out-dir", "again", "--no-report")
    command = [sys.executable, "-m", "mocapclean", *words, "--method", "linear"]
    done = subprocess.run(command, input=listing, capture_output=True, timeout=60)
    assert done.returncode == 0, done.stderr
    for folder in (Path("clean"), Path("again")):
        found = {name: found for name, found in hashes(folder).items() if not name.startswith(".mocapclean")}
        assert set(found) == set(ODD)
    assert hashes(captures) == before
    shutil.rmtree("captures")
    store(captures, *NAMES)


def test_a_name_with_no_room_for_its_report_is_told(captures):
    shutil.rmtree("captures")
    store(captures, "n" * 246 + ".c3d", "a.c3d")
    words = ["fill", "captures", "--out-dir", "clean", "--method", "linear"]
    done = subprocess.run([sys.executable, "-m", "mocapclean", *words], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "report.json: cannot be written: File name too long" in done.stderr
    assert len(list(Path("clean").glob("*.c3d"))) == 2
    assert not list(Path("clean").glob(".n*"))
    shutil.rmtree("captures")
    store(captures, *NAMES)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_asked_to_stop_a_run_reports_all_takes(hanging, number, code):
    process = start("--workers", 1)
    until(lambda: "b.c3d" in outputs() and stuck(process))
    os.killpg(process.pid, number)
    if number == signal.SIGINT:
        time.sleep(0.5)
        assert process.poll() is None
    err = end(process, code, hanging / HANGS if number == signal.SIGINT else None)
    assert "Interrupted" in err
    found = statuses()
    assert len(found) == len(NAMES) + 1
    assert found["z.c3d"] == "skipped"
    assert found[HANGS] == ("failed" if number == signal.SIGINT else "skipped")
    assert_true(rows_of(Path("all.json")), Path("clean"))


def test_interrupted_twice_it_ends_at_once(hanging):
    process = start("--workers", 1)
    until(lambda: "b.c3d" in outputs() and stuck(process))
    os.killpg(process.pid, signal.SIGINT)
    time.sleep(0.5)
    os.killpg(process.pid, signal.SIGINT)
    end(process, 130)
    until(lambda: not workers_of(process))
    assert not list(Path("clean").rglob("*.part*"))
    (hanging / HANGS).unlink()
    resumed()
