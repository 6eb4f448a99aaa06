"""The same run on a Dask cluster: a real scheduler and real workers, as separate processes on this machine."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from small_takes import assert_true, hashes, rows_of, small, store

from mocapclean.batch.cluster import run
from mocapclean.batch.limits import WorkerLimits
from mocapclean.batch.pool import Stop
from mocapclean.errors import UsageError

pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")

NAMES = tuple(f"day {number % 3}/{number:02}.c3d" for number in range(12))


def dask(*words, folder):
    command = [sys.executable, "-m", "distributed.cli.dask_" + words[0], *map(str, words[1:])]
    return subprocess.Popen(
        command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )


def end(*processes):
    for process in processes:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """The address of a scheduler with two workers of one thread each."""
    folder = tmp_path_factory.mktemp("cluster")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    words = ("--host", "127.0.0.1", "--port", address.rpartition(":")[2], "--no-dashboard")
    processes = [dask("scheduler", *words, folder=folder)]
    for name in ("one", "two"):
        words = (address, "--nthreads", 1, "--nworkers", 1, "--no-dashboard", "--name", name)
        processes.append(dask("worker", *words, "--local-directory", folder / name, folder=folder))
    yield address
    end(*processes)


@pytest.fixture
def captures(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = store(tmp_path / "captures", *NAMES)
    (folder / "broken.c3d").write_bytes(small()[:1000])
    return folder


def start(captures, out, *arguments):
    words = ["fill", captures, "--out-dir", out, "--method", "linear", "--report", f"{out}.json", *arguments]
    command = [sys.executable, "-m", "mocapclean", *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(process, code):
    _, err = process.communicate(timeout=120)
    assert process.returncode == code, err
    assert "Traceback" not in err
    return err


def content(out):
    return {name: found for name, found in hashes(Path(out)).items() if not name.startswith(".mocapclean")}


def rows(out):
    found = rows_of(Path(f"{out}.json"))
    assert_true(found, Path(out))
    return {source: {**row, "seconds": 0, "output": None} for source, row in found.items()}


def test_a_cluster_writes_the_same_bytes_and_rows_as_this_machine(cluster, captures):
    finish(start(captures, "here"), 1)
    finish(start(captures, "there", "--scheduler", cluster), 1)
    assert content("there") == content("here")
    assert len(content("here")) == len(NAMES)
    assert rows("there") == rows("here")
    finish(start("captures", "there", "--scheduler", cluster, "--resume"), 1)
    assert rows("there") == rows("here")


def test_a_worker_that_is_killed_in_the_middle_costs_nothing_but_time(cluster, captures):
    finish(start(captures, "here"), 1)
    os.mkfifo(captures / "00.c3d")
    process = start(captures, "there", "--scheduler", cluster)
    pid = until(reader)
    (captures / "00.c3d").unlink()
    (captures / "00.c3d").write_bytes(small(77))
    os.kill(pid, signal.SIGKILL)
    finish(process, 1)
    finish(start(captures, "here", "--resume", "--overwrite"), 1)
    assert content("there") == content("here")
    assert rows("there") == rows("here")


def test_a_take_that_hangs_on_a_cluster_is_given_up(cluster, captures):
    os.mkfifo(captures / "00.c3d")
    for name in NAMES[2:]:
        (captures / name).unlink()
    err = finish(start(captures, "there", "--scheduler", cluster, "--timeout", 5, "--memory", "1GiB"), 1)
    assert "00.c3d: it took longer than the limit of 5 s" in err
    assert len(content("there")) == 2
    assert {row["status"] for row in rows("there").values()} == {"repaired", "failed"}


def test_no_scheduler_is_one_sentence(captures):
    err = finish(start(captures, "there", "--scheduler", "nonsense://x"), 2)
    assert "no Dask scheduler responds there" in err


def test_workers_that_do_not_see_the_files_are_told_of(cluster, captures):
    answers = run(None, [1], cluster, WorkerLimits(), [captures, Path("nowhere").absolute()], Stop())
    with pytest.raises(UsageError, match=r"cannot see .*nowhere"):
        next(answers)


def reader():
    """The process that waits for a named pipe, if there is one."""
    for name in filter(str.isdigit, os.listdir("/proc")):
        with contextlib.suppress(OSError):
            for task in os.listdir(f"/proc/{name}/task"):
                if Path(f"/proc/{name}/task/{task}/wchan").read_text() == "wait_for_partner":
                    command = Path(f"/proc/{name}/cmdline").read_bytes()
                    if b"spawn_main" in command or b"dask" in command:
                        return int(name)
    return None


def until(condition):
    deadline = time.monotonic() + 60
    while not (found := condition()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return found


def test_json_rows_come_from_a_cluster_too(cluster, captures):
    process = start(captures, "there", "--scheduler", cluster, "--json")
    out, _ = process.communicate(timeout=120)
    assert len([json.loads(line) for line in out.splitlines()]) == len(NAMES) + 1
