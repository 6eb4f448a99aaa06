"""Work at jobs in processes of this machine: one that dies, hangs or takes too much costs its own job and no other.

Every process has a pool of its own (pebble), so that one that is killed cannot tear a message, or hold a lock, that
another waits for. No job is handed out before its process is free, so that what is not begun can be given up.
"""

import multiprocessing
import os
import signal
import threading
import traceback
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from multiprocessing.connection import wait as wait_for
from pathlib import Path
from typing import Any, Protocol, TypeVar

from pebble import ProcessExpired, ProcessPool

from mocapclean.batch.limits import Limits, memory_limit
from mocapclean.errors import MocapcleanError, WorkerError

Job = TypeVar("Job")
Answer = TypeVar("Answer")
_In = TypeVar("_In", contravariant=True)
_Out = TypeVar("_Out", covariant=True)

Answers = Generator[tuple[Job, Answer | MocapcleanError], None, None]

_POLL = 0.2  # seconds
_PATIENCE = 5.0  # seconds


class Work(Protocol[_In, _Out]):
    """What is done with a job: can be pickled, and tidies up behind a process that was lost over it."""

    def __call__(self, job: _In) -> _Out:
        """Do the job, in a process of its own."""

    def undo(self, job: _In) -> None:
        """Remove what a lost process may have left behind; called here, not there."""


class Stop:
    """The signals that ask a run to stop: by the first one nothing more is begun, the second one raises at once.

    ``signal``: the first one's number, or 0. ``tell`` is called by the first one if it is not the last. A handler for
    ``signal.signal``.
    """

    def __init__(self, tell: Callable[[], object] = bool) -> None:
        self.signal = 0
        self.at_once = False
        self.tell = tell

    def __call__(self, number: int, frame: object) -> None:
        """Take note of a signal; KeyboardInterrupt when it is the second, or none can be waited for."""
        first, self.signal = not self.signal, self.signal or number
        if self.at_once or not first:
            raise KeyboardInterrupt(number)
        self.tell()


def run(work: Work[Job, Answer], jobs: Iterable[Job], limits: Limits, stop: Stop) -> Answers[Job, Answer]:
    """Each job with its answer, or with why its process was lost, in the order in which they are done.

    A job is taken from ``jobs`` when it is begun and not before. Asked to stop, it begins nothing more. After SIGINT
    what runs is finished, after SIGTERM it is dropped; jobs that were dropped do not appear. Without workers the jobs
    are done here, without limits, and any signal drops the one that runs.
    """
    return _there(work, jobs, limits, stop) if limits.workers else _here(work, jobs, stop)


def _here(work: Work[Job, Answer], jobs: Iterable[Job], stop: Stop) -> Answers[Job, Answer]:
    for job in jobs:
        stop.at_once = True
        try:
            answer = attempt(work, job)
        except KeyboardInterrupt:
            if not stop.signal:
                raise
            return
        finally:
            stop.at_once = False
        yield job, answer


def _there(work: Work[Job, Answer], jobs: Iterable[Job], limits: Limits, stop: Stop) -> Answers[Job, Answer]:
    seats = [_Seat(limits) for _ in range(limits.workers)]
    busy: dict[Future[Any], tuple[_Seat, Job]] = {}
    ended: list[tuple[Job, Answer | MocapcleanError]] = []
    waiting = iter(jobs)
    try:
        while stop.signal != signal.SIGTERM:
            while seats and not stop.signal and (job := next(waiting, None)) is not None:
                seat = seats.pop()
                busy[seat.begin(work, job)] = seat, job
            yield from ended
            if not busy:
                return
            done, _ = wait(busy, timeout=_POLL, return_when=FIRST_COMPLETED)
            ended = []
            for future in done:
                seat, job = busy.pop(future)
                answer = seat.end(future)
                seats.append(seat)
                if isinstance(answer, WorkerError):
                    work.undo(job)
                    if stop.signal == signal.SIGTERM:  # which may have reached the process as well
                        continue
                ended.append((job, answer))
        yield from ended
    finally:
        _retire(*(seat.pool for seat in seats), *(seat.pool for seat, _ in busy.values()))
        for _, job in busy.values():
            work.undo(job)


def attempt(work: Work[Job, Answer], job: Job) -> Answer | MocapcleanError:
    """Do a job; whatever goes wrong with it is an answer as well."""
    try:
        return work(job)
    except MocapcleanError as fault:
        return fault
    except MemoryError:
        return WorkerError("there is not enough memory for this take.")
    except Exception as bug:
        place = traceback.extract_tb(bug.__traceback__)[-1]
        where = f"{Path(place.filename).name}, line {place.lineno}"
        return WorkerError(f"unexpected {type(bug).__name__} in {where}: {bug}. This is a defect of mocapclean.")


def _within(work: Work[Job, Answer], job: Job, memory: int | None) -> Answer | MocapcleanError:
    """Do a job in a process of the pool."""
    with memory_limit(memory):
        return attempt(work, job)


class _Seat:
    """One process at a time, and another one when it is lost."""

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.pool = _pool()

    def begin(self, work: Work[Job, Answer], job: Job) -> Future[Answer | MocapcleanError]:
        """Hand a job to the process; to a new one where the old one died idle."""
        arguments = (work, job, self.limits.memory)
        try:
            return self.pool.schedule(_within, args=arguments, timeout=self.limits.timeout)
        except RuntimeError:
            self._replace()
            return self.pool.schedule(_within, args=arguments, timeout=self.limits.timeout)

    def end(self, future: Future[Answer | MocapcleanError]) -> Answer | MocapcleanError:
        """The answer, or how the process was lost."""
        try:
            return future.result()
        except TimeoutError:
            lost = WorkerError(f"it took longer than the limit of {self.limits.timeout:g} s (--timeout).")
        except ProcessExpired as death:
            lost = WorkerError(f"its process {end_of(death.exitcode)}.")
        except Exception as fault:
            lost = WorkerError(f"its process could not be used: {fault}.")
        self._replace()
        return lost

    def _replace(self) -> None:
        _retire(self.pool)
        self.pool = _pool()


def end_of(code: int) -> str:
    """How a process ended, by its exit code, negative for a signal."""
    if code >= 0:
        return f"ended with exit code {code}"
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    return f"was killed by {name}" + ("; the system does that when memory runs out" if name == "SIGKILL" else "")


def _pool() -> ProcessPool:
    served = "forkserver" in multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("forkserver" if served else "spawn")
    if served:
        context.set_forkserver_preload(["mocapclean.batch.repairing"])
    return ProcessPool(max_workers=1, initializer=_prepare, context=context)


def _prepare() -> None:
    """In a new process: leave Ctrl-C to the parent, end at once when told to, and when the parent is no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_follow, daemon=True).start()


def _follow() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for([parent.sentinel])
        os._exit(1)


def _retire(*pools: ProcessPool) -> None:
    """End pools and their processes; one that a torn message holds up is left to the end of the program."""
    for pool in pools:
        pool.stop()  # type: ignore[no-untyped-call]
    threads = [threading.Thread(target=pool.join, daemon=True) for pool in pools]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=_PATIENCE)
