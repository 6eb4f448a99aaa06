"""Work at jobs on a Dask cluster that exists already: the same work, the same answers.

A job whose worker is lost goes to another one by itself. The cluster's workers read and write on storage that they
share with this machine.
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
from mocapclean.batch.alone import alone
from mocapclean.batch.limits import Limits
from mocapclean.batch.pool import Answer, Answers, Job, Stop, Work, attempt
from mocapclean.errors import MocapcleanError, UsageError, WorkerError

if TYPE_CHECKING:
    from distributed import Client, Future

_GONE = "the cluster is no longer there."
_LOST = {
    "KilledWorker": "its worker was lost again and again.",
    **dict.fromkeys(("CancelledError", "FutureCancelledError"), _GONE),
}
_POLL = 0.2  # seconds
_PATIENCE = 10  # seconds


def run(
    work: Work[Job, Answer], jobs: Iterable[Job], scheduler: str, limits: Limits, shared: Sequence[Path], stop: Stop
) -> Answers[Job, Answer]:
    """Each job with its answer, or with why it was lost, in the order in which they are done.

    shared: paths that every worker must see. With a limit of time or memory each job has a process of its own. Asked to
    stop, by SIGTERM as by SIGINT, it begins nothing more and waits for what runs, which a cluster cannot take back.
    Raises UsageError when there is no such cluster, or it does not see the files or has another version.
    """
    with contextlib.closing(_connect(scheduler)) as client:
        _probe(client, shared)
        yield from _work_through(client, work, jobs, limits, stop)


def _work_through(
    client: "Client", work: Work[Job, Answer], jobs: Iterable[Job], limits: Limits, stop: Stop
) -> Answers[Job, Answer]:
    ended: queue.SimpleQueue[Future] = queue.SimpleQueue()
    busy: dict[str, tuple[Future, Job]] = {}
    waiting = iter(jobs)
    try:
        while client.status == "running":
            most = 2 * sum(client.nthreads().values())
            while len(busy) < most and not stop.signal and (job := next(waiting, None)) is not None:
                future = client.submit(_do, work, job, limits, pure=False)
                busy[future.key] = future, job
                future.add_done_callback(ended.put)
            if not busy:
                return
            with contextlib.suppress(queue.Empty):
                future, job = busy.pop(ended.get(timeout=_POLL).key)
                answer = _answer(future)
                if isinstance(answer, WorkerError):
                    work.undo(job)
                yield job, answer
        for _, job in busy.values():
            yield job, WorkerError(_GONE)
    finally:
        client.cancel([future for future, _ in busy.values()])


def _do(work: Work[Job, Answer], job: Job, limits: Limits) -> Answer | MocapcleanError:
    """Do a job, on a worker."""
    if limits.timeout is None and limits.memory is None:
        return attempt(work, job)
    return alone(work, job, limits)


def _answer(future: "Future") -> Any:
    try:
        return future.result(timeout=_PATIENCE)
    except Exception as fault:
        kind = type(fault).__name__
        return WorkerError(_LOST.get(kind, f"its worker could not be used: {kind}: {fault}."))


def _connect(scheduler: str) -> "Client":
    try:
        from distributed import Client
        from distributed.comm import connect
    except ImportError:
        raise UsageError("--scheduler needs Dask. Use pip install 'mocapclean[cluster]'.") from None
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        asyncio.run(connect(scheduler, timeout=_PATIENCE)).abort()
    except (OSError, ValueError) as fault:
        raise UsageError(f"{scheduler}: no Dask scheduler answers there: {fault}.") from None
    client = Client(scheduler, timeout=_PATIENCE, set_as_default=False)
    try:
        client.wait_for_workers(1, timeout=_PATIENCE)
    except TimeoutError:
        client.close()
        raise UsageError(f"{scheduler}: the cluster must have workers. Got none.") from None
    return client


def _probe(client: "Client", shared: Sequence[Path]) -> None:
    """Raise UsageError unless all workers have this version and see the paths."""
    try:
        found = client.run(_seen, [str(path) for path in shared])
    except Exception as fault:
        raise UsageError(f"the cluster's workers must have mocapclean {__version__} installed: {fault}.") from None
    for worker, (version, unseen) in found.items():
        if version != __version__:
            raise UsageError(f"{worker}: the cluster's workers must have mocapclean {__version__}. Got {version}.")
        if unseen:
            raise UsageError(f"{worker}: the worker cannot see {unseen[0]}. Workers must share the storage.")


def _seen(paths: Sequence[str]) -> tuple[str, list[str]]:
    """The version, and which of the paths are not there, on a worker."""
    return __version__, [path for path in paths if not os.path.exists(path)]
