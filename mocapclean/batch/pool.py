"""Run jobs in processes of this machine; a process that crashes, hangs or exceeds a limit fails its own job only.

Every process has a pool of its own (pebble). So a killed process cannot tear a message or hold a lock that another
process needs. A job is handed out only when its process is free, so that a stopped run can give up all other jobs.
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

from mocapclean.batch.limits import WorkerLimits, memory_limit
from mocapclean.errors import MocapcleanError, WorkerError

Job = TypeVar("Job")
Result = TypeVar("Result")
_In = TypeVar("_In", contravariant=True)
_Out = TypeVar("_Out", covariant=True)

JobResults = Generator[tuple[Job, Result | MocapcleanError], None, None]

_POLL_INTERVAL = 0.2
"""Seconds until signals are checked again; chosen by hand."""

_JOIN_TIMEOUT = 5.0
"""Seconds that a stopped pool may need to end; chosen by hand."""


class Work(Protocol[_In, _Out]):
    """A picklable function of a job, with the clean-up after a lost process."""

    def __call__(self, job: _In) -> _Out:
        """Return the result of a job; called in the worker process."""

    def undo(self, job: _In) -> None:
        """Remove the files that a lost process may have left; called in the main process."""


class Stop:
    """A handler for ``signal.signal`` that stops a run: the first signal starts no further job, the second raises.

    ``signal`` is the number of the first signal, or 0. ``announce`` is called with it unless the first signal raises.
    While ``at_once`` is set, the first signal raises as well.
    """

    def __init__(self, announce: Callable[[int], object] = bool) -> None:
        self.signal = 0
        self.at_once = False
        self.announce = announce

    def __call__(self, number: int, frame: object) -> None:
        """Record the first signal; raise KeyboardInterrupt for the second, or if ``at_once`` is set."""
        is_first, self.signal = not self.signal, self.signal or number
        if self.at_once or not is_first:
            raise KeyboardInterrupt(number)
        self.announce(number)


def run(work: Work[Job, Result], jobs: Iterable[Job], limits: WorkerLimits, stop: Stop) -> JobResults[Job, Result]:
    """Yield each job with its result, or with the error of its lost process, in the order in which they finish.

    The next job is taken from ``jobs`` when it starts, not before. After a signal no further job starts: SIGINT lets
    running jobs finish, SIGTERM drops them, and dropped jobs are not yielded. With 0 workers the jobs run in this
    process without limits, and any signal drops the running job.
    """
    return _run_in_workers(work, jobs, limits, stop) if limits.workers else _run_here(work, jobs, stop)


def _run_here(work: Work[Job, Result], jobs: Iterable[Job], stop: Stop) -> JobResults[Job, Result]:
    """Run the jobs one after another in this process."""
    for job in jobs:
        stop.at_once = True
        try:
            result = attempt(work, job)
        except KeyboardInterrupt:
            if not stop.signal:
                raise
            return
        finally:
            stop.at_once = False
        yield job, result


def _run_in_workers(
    work: Work[Job, Result], jobs: Iterable[Job], limits: WorkerLimits, stop: Stop
) -> JobResults[Job, Result]:
    """Run the jobs in worker processes, one job per process at a time."""
    free = [_Worker(limits) for _ in range(limits.workers)]
    busy: dict[Future[Any], tuple[_Worker, Job]] = {}
    finished: list[tuple[Job, Result | MocapcleanError]] = []
    pending = iter(jobs)
    try:
        while stop.signal != signal.SIGTERM:
            # Start the next jobs before results are yielded, so that no process is idle while the caller uses them.
            while free and not stop.signal and (job := next(pending, None)) is not None:
                worker = free.pop()
                busy[worker.begin(work, job)] = worker, job
            yield from finished
            if not busy:
                return
            done, _ = wait(busy, timeout=_POLL_INTERVAL, return_when=FIRST_COMPLETED)
            finished = []
            for future in done:
                worker, job = busy.pop(future)
                result = worker.end(future)
                free.append(worker)
                if isinstance(result, WorkerError):
                    work.undo(job)
                    if stop.signal == signal.SIGTERM:  # the same SIGTERM may have ended the worker
                        continue
                finished.append((job, result))
        yield from finished
    finally:
        _shut_down(*(worker.pool for worker in free), *(worker.pool for worker, _ in busy.values()))
        for _, job in busy.values():
            work.undo(job)


def attempt(work: Work[Job, Result], job: Job) -> Result | MocapcleanError:
    """Return the result of a job, or the error that it raises."""
    try:
        return work(job)
    except MocapcleanError as error:
        return error
    except MemoryError:
        return WorkerError("there is not enough memory for this take.")
    except Exception as bug:
        place = traceback.extract_tb(bug.__traceback__)[-1]
        where = f"{Path(place.filename).name}, line {place.lineno}"
        return WorkerError(f"unexpected {type(bug).__name__} in {where}: {bug}. This is a defect of mocapclean.")


def _attempt_within(work: Work[Job, Result], job: Job, memory: int | None) -> Result | MocapcleanError:
    """Return the result of a job within a limit of memory, bytes; called in the worker process."""
    with memory_limit(memory):
        return attempt(work, job)


class _Worker:
    """One worker process, replaced by a new process whenever it is lost."""

    def __init__(self, limits: WorkerLimits) -> None:
        self.limits = limits
        self.pool = _new_pool()

    def begin(self, work: Work[Job, Result], job: Job) -> Future[Result | MocapcleanError]:
        """Start a job in the process, or in a new process if the old one has died since its last job."""
        arguments = (work, job, self.limits.memory)
        try:
            return self.pool.schedule(_attempt_within, args=arguments, timeout=self.limits.timeout)
        except RuntimeError:
            self._replace()
            return self.pool.schedule(_attempt_within, args=arguments, timeout=self.limits.timeout)

    def end(self, future: Future[Result | MocapcleanError]) -> Result | MocapcleanError:
        """Return the result of a finished job, or a WorkerError if the process was lost."""
        try:
            return future.result()
        except TimeoutError:
            lost = timeout_error(self.limits)
        except ProcessExpired as death:
            lost = WorkerError(f"its process {exit_description(death.exitcode)}.")
        except Exception as error:
            lost = WorkerError(f"its process could not be used: {error}.")
        self._replace()
        return lost

    def _replace(self) -> None:
        _shut_down(self.pool)
        self.pool = _new_pool()


def timeout_error(limits: WorkerLimits) -> WorkerError:
    """Return the error of a take that exceeded the limit of time."""
    return WorkerError(f"it took longer than the limit of {limits.timeout:g} s (--timeout).")


def exit_description(code: int) -> str:
    """Return how a process ended, in words, from its exit code; a negative code is the number of a signal."""
    if code >= 0:
        return f"ended with exit code {code}"
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    return f"was killed by {name}" + ("; the system does that when memory runs out" if name == "SIGKILL" else "")


def _new_pool() -> ProcessPool:
    """Return a pool of one process. It is not forked from this process, whose threads may hold locks."""
    has_forkserver = "forkserver" in multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("forkserver" if has_forkserver else "spawn")
    if has_forkserver:
        context.set_forkserver_preload(["mocapclean.batch.repairing"])
    return ProcessPool(max_workers=1, initializer=_prepare_worker, context=context)


def _prepare_worker() -> None:
    """Set up a worker process: it ignores Ctrl-C, ends at SIGTERM, and ends when its parent has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    """End this process as soon as its parent has ended."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for([parent.sentinel])
        os._exit(1)


def _shut_down(*pools: ProcessPool) -> None:
    """End pools and their processes. A pool that a torn message blocks stays until the program ends."""
    for pool in pools:
        pool.stop()  # type: ignore[no-untyped-call]
    threads = [threading.Thread(target=pool.join, daemon=True) for pool in pools]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=_JOIN_TIMEOUT)
