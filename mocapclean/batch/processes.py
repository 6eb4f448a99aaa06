"""Run jobs in processes of this machine; a process that crashes, hangs or exceeds a limit fails its own job only.

Every process has a pool of its own (pebble). So a killed process cannot tear a message or hold a lock that another
process needs. A job is handed out only when its process is free, so that a stopped run can give up all other jobs.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from multiprocessing.connection import wait as wait_for
from typing import Any

from pebble import ProcessExpired, ProcessPool

from mocapclean import logs
from mocapclean.batch.limits import WorkerLimits, memory_limit
from mocapclean.batch.pool import Job, JobResults, Result, Stop, Work, attempt, exit_description, timeout_error
from mocapclean.errors import MocapcleanError, WorkerError

_POLL_INTERVAL = 0.2
"""Seconds until signals are checked again; chosen by hand."""

_JOIN_TIMEOUT = 5.0
"""Seconds that a stopped pool may need to end; chosen by hand."""


def run_in_workers(
    work: Work[Job, Result], jobs: Iterable[Job], limits: WorkerLimits, stop: Stop
) -> JobResults[Job, Result]:
    """Run the jobs in worker processes, one job per process at a time."""
    free = [_Worker(limits, type(work).__module__) for _ in range(limits.workers)]
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


def _attempt_within(work: Work[Job, Result], job: Job, memory: int | None) -> Result | MocapcleanError:
    """Return the result of a job within a limit of memory, bytes; called in the worker process."""
    with memory_limit(memory):
        return attempt(work, job)


class _Worker:
    """One worker process, replaced by a new process whenever it is lost."""

    def __init__(self, limits: WorkerLimits, module: str) -> None:
        self.limits, self.module = limits, module
        self.pool = _new_pool(module)

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
        self.pool = _new_pool(self.module)


def _new_pool(module: str) -> ProcessPool:
    """Return a pool of one process. It is not forked from this process, whose threads may hold locks.

    module: that of the work, which is loaded once for all processes.
    """
    has_forkserver = "forkserver" in multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("forkserver" if has_forkserver else "spawn")
    if has_forkserver:
        context.set_forkserver_preload([module])
    return ProcessPool(max_workers=1, initializer=_prepare_worker, initargs=[logs.shown_level()], context=context)


def _prepare_worker(log_level: int) -> None:
    """Set up a worker process: it ignores Ctrl-C, ends at SIGTERM, ends when its parent has ended, and logs as that."""
    if log_level:
        logs.show(log_level)
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
