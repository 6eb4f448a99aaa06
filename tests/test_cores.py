"""The parts of the work on one take: the same results on any number of cores, and errors as without processes."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from mocapclean import cores
from mocapclean.errors import UsageError, WorkerError
from mocapclean.simulate import hide, perform
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method


def square(offset: int, number: int) -> int:
    return number**2 + offset


def process(_: int) -> int:
    return os.getpid()


def refuse(number: int) -> int:
    raise UsageError(f"number {number}")


def die(_: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


@pytest.mark.parametrize("n", [1, 2, 3])
def test_results_come_in_the_order_of_the_parts(n):
    with cores.sharing(n):
        assert list(cores.in_parts(partial(square, 7), range(9))) == [7 + k**2 for k in range(9)]


def test_parts_run_in_other_processes_only_where_cores_are_shared():
    assert set(cores.in_parts(process, range(4))) == {os.getpid()}
    if sys.platform == "linux":
        with cores.sharing(2):
            assert os.getpid() not in set(cores.in_parts(process, range(4)))
            assert list(cores.in_parts(process, range(1))) == [os.getpid()]


@pytest.mark.parametrize("n", [1, 2])
def test_an_error_of_a_part_is_raised(n):
    with cores.sharing(n), pytest.raises(UsageError, match="number 0"):
        list(cores.in_parts(refuse, range(4)))


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere few parts run in this process")
def test_a_process_that_is_killed_is_told_in_a_sentence():
    with cores.sharing(2), pytest.raises(WorkerError, match="memory"):
        list(cores.in_parts(die, range(4)))


def gappy():
    """A walk with seventy gaps of 3 to 40 frames."""
    take, rng = perform("walk", 6.0, 100.0).markers, np.random.default_rng(4)
    missing = np.zeros_like(take.trusted)
    for _ in range(70):
        marker, start = rng.integers(take.trusted.shape[1]), rng.integers(0, 560)
        missing[start : start + rng.integers(3, 40), marker] = True
    return hide(take, missing)


@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_a_fill_has_the_same_bytes_on_any_number_of_cores(start, monkeypatch):
    if start == "fork" and sys.platform != "linux":
        pytest.skip("fork is used on Linux alone")
    monkeypatch.setattr(cores, "_START", start)
    monkeypatch.setattr(cores, "_LEAST_PARTS", 2)
    take, params = gappy(), SOLVERS["kriging"].Params()
    alone = run_method("kriging", take, params)
    with cores.sharing(2):
        shared = run_method("kriging", take, params)
    assert alone.filled.any()
    for field in ("positions", "filled", "sd"):
        assert getattr(alone, field).tobytes() == getattr(shared, field).tobytes()


ENDLESS = """
import multiprocessing, sys, time
from mocapclean import cores
if __name__ == "__main__":
    with cores.sharing(2):
        try:
            for part in cores.in_parts(time.sleep, [0, 0, *[600] * 8]):
                print(*(child.pid for child in multiprocessing.active_children()), flush=True)
        except KeyboardInterrupt:
            sys.exit(130)
"""


def runs(pid: int) -> bool:
    """Return whether a process still works: it exists, and is no zombie that nobody has waited for."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="processes are looked up in /proc")
@pytest.mark.parametrize(
    ("signals", "codes"),
    [
        ((signal.SIGINT,), {130}),
        ((signal.SIGINT, signal.SIGINT), {130, -signal.SIGINT, 1}),
        ((signal.SIGKILL,), {-signal.SIGKILL}),
    ],
    ids=["one", "two", "killed"],
)
def test_a_signal_ends_the_work_at_once_and_leaves_no_process(signals, codes):
    command = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n" + ENDLESS
    with subprocess.Popen([sys.executable, "-c", command], stdout=subprocess.PIPE, start_new_session=True) as process:
        assert process.stdout
        children = [int(word) for word in process.stdout.readline().split()]
        assert len(children) == 2
        time.sleep(0.5)  # both parts without an end have begun
        for number in signals:
            os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
            time.sleep(0.1)
        try:
            assert process.wait(20) in codes
            deadline = time.monotonic() + 10
            while any(map(runs, children)) and time.monotonic() < deadline:
                time.sleep(0.05)
            assert not any(map(runs, children))
        finally:
            for pid in (process.pid, *children):
                if runs(pid):
                    os.kill(pid, signal.SIGKILL)
