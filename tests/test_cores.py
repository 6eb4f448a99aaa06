"""The parts of the work on one take: the same results on any number of cores, and errors as without processes."""

import os
import signal
import sys
from functools import partial

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
