"""Run jobs on a running Dask cluster, with the same results as on this machine.

Dask gives the job of a lost worker to another worker. The workers read and write on storage shared with this machine.
"""

import asyncio
import contextlib
import logging
import os
import queue
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mocapclean import __version__
from mocapclean.batch.isolated import run_isolated
from mocapclean.batch.limits import WorkerLimits
from mocapclean.batch.pool import Job, JobResults, Result, Stop, Work, attempt
from mocapclean.errors import MocapcleanError, UsageError, WorkerError

if TYPE_CHECKING:
    from distributed import Client, Future

_CLUSTER_LOST = "the cluster is no longer there."
_LOST_MESSAGES = {
    "KilledWorker": "its worker was lost again and again.",
    **dict.fromkeys(("CancelledError", "FutureCancelledError"), _CLUSTER_LOST),
}
"""Messages by the name of Dask's exception; its classes must not be imported before --scheduler is given."""

_POLL_INTERVAL = 0.2
"""Seconds until signals and the state of the cluster are checked again; chosen by hand."""

_CONNECT_TIMEOUT = 10
"""Seconds that a scheduler or worker may need to respond; chosen by hand."""

_JOBS_PER_THREAD = 2
"""Jobs submitted per thread of the cluster: one runs and one is queued, so that no thread is idle."""


def run(
    work: Work[Job, Result],
    jobs: Iterable[Job],
    scheduler: str,
    limits: WorkerLimits,
    shared: Sequence[Path],
    stop: Stop,
) -> JobResults[Job, Result]:
    """Yield each job with its result, or with the error of its lost worker, in the order in which they finish.

    shared: paths that every worker must be able to read. With a limit of time or memory each job runs in a process of
    its own. After SIGINT or SIGTERM no further job starts; running jobs finish, because a cluster cannot recall them.
    Raises UsageError if there is no such cluster, or if a worker does not see the files or has another version.
    """
    with contextlib.closing(_connect(scheduler)) as client:
        _check_workers(client, shared)
        yield from _run_jobs(client, work, jobs, limits, stop)


def _run_jobs(
    client: "Client", work: Work[Job, Result], jobs: Iterable[Job], limits: WorkerLimits, stop: Stop
) -> JobResults[Job, Result]:
    """Submit jobs as threads become free, and yield each result when it arrives."""
    finished: queue.SimpleQueue[Future] = queue.SimpleQueue()
    running: dict[str, tuple[Future, Job]] = {}
    pending = iter(jobs)
    try:
        while client.status == "running":
            capacity = _JOBS_PER_THREAD * sum(client.nthreads().values())
            while len(running) < capacity and not stop.signal and (job := next(pending, None)) is not None:
                future = client.submit(_run_on_worker, work, job, limits, pure=False)
                running[future.key] = future, job
                future.add_done_callback(finished.put)
            if not running:
                return
            with contextlib.suppress(queue.Empty):
                future, job = running.pop(finished.get(timeout=_POLL_INTERVAL).key)
                result = _result(future)
                if isinstance(result, WorkerError):
                    work.undo(job)
                yield job, result
        for _, job in running.values():
            yield job, WorkerError(_CLUSTER_LOST)
    finally:
        client.cancel([future for future, _ in running.values()])


def _run_on_worker(work: Work[Job, Result], job: Job, limits: WorkerLimits) -> Result | MocapcleanError:
    """Return the result of a job; called on a worker."""
    if limits.timeout is None and limits.memory is None:
        return attempt(work, job)
    return run_isolated(work, job, limits)


def _result(future: "Future") -> Any:
    """Return the result of a finished job, or a WorkerError if its worker was lost."""
    try:
        return future.result(timeout=_CONNECT_TIMEOUT)
    except Exception as error:
        kind = type(error).__name__
        return WorkerError(_LOST_MESSAGES.get(kind, f"its worker could not be used: {kind}: {error}."))


def _connect(scheduler: str) -> "Client":
    """Return a client of a scheduler with at least one worker; raise UsageError if there is none."""
    try:
        from distributed import Client
        from distributed.comm import connect
    except ImportError:
        raise UsageError("--scheduler needs Dask. Run pip install '.[cluster]' in the clone of mocapclean.") from None
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        asyncio.run(connect(scheduler, timeout=_CONNECT_TIMEOUT)).abort()
    except (OSError, ValueError) as error:
        raise UsageError(f"{scheduler}: no Dask scheduler responds there: {error}.") from None
    client = Client(scheduler, timeout=_CONNECT_TIMEOUT, set_as_default=False)
    try:
        client.wait_for_workers(1, timeout=_CONNECT_TIMEOUT)
    except TimeoutError:
        client.close()
        raise UsageError(f"{scheduler}: the cluster must have workers. Got none.") from None
    return client


def _check_workers(client: "Client", shared: Sequence[Path]) -> None:
    """Raise UsageError unless every worker has this version of mocapclean and sees the shared paths."""
    try:
        by_worker = client.run(_version_and_absent, [str(path) for path in shared])
    except Exception as error:
        raise UsageError(f"the cluster's workers must have mocapclean {__version__} installed: {error}.") from None
    for worker, (version, absent) in by_worker.items():
        if version != __version__:
            raise UsageError(f"{worker}: the cluster's workers must have mocapclean {__version__}. Got {version}.")
        if absent:
            raise UsageError(f"{worker}: the worker cannot see {absent[0]}. Workers must share the storage.")


def _version_and_absent(paths: Sequence[str]) -> tuple[str, list[str]]:
    """Return the version of mocapclean and the paths that do not exist; called on a worker."""
    return __version__, [path for path in paths if not os.path.exists(path)]
