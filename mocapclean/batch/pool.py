"""Run jobs, in this process or in worker processes, and stop the run at a signal."""

import signal
import traceback
from collections.abc import Callable, Generator, Iterable
from pathlib import Path
from typing import Protocol, TypeVar

from mocapclean.batch.limits import WorkerLimits
from mocapclean.cores import sharing
from mocapclean.errors import MocapcleanError, WorkerError

Job = TypeVar("Job")
Result = TypeVar("Result")
_In = TypeVar("_In", contravariant=True)
_Out = TypeVar("_Out", covariant=True)

JobResults = Generator[tuple[Job, Result | MocapcleanError], None, None]


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
    if not limits.workers:
        return _run_here(work, jobs, limits.cores, stop)
    from mocapclean.batch.processes import run_in_workers  # a single take needs no process and no pool

    return run_in_workers(work, jobs, limits, stop)


def _run_here(work: Work[Job, Result], jobs: Iterable[Job], cores: int, stop: Stop) -> JobResults[Job, Result]:
    """Run the jobs one after another in this process, each on so many cores."""
    for job in jobs:
        stop.at_once = True
        try:
            with sharing(cores):
                result = attempt(work, job)
        except KeyboardInterrupt:
            if not stop.signal:
                raise
            return
        finally:
            stop.at_once = False
        yield job, result


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


def timeout_error(limits: WorkerLimits) -> WorkerError:
    """Return the error of a take that exceeded the limit of time."""
    return WorkerError(f"it took longer than the limit of {limits.timeout:g} s (--timeout).")


def exit_description(code: int) -> str:
    """Return how a process ended, in words, from its exit code; a negative code is the number of a signal."""
    if code >= 0:
        return f"ended with exit code {code}"
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    return f"was killed by {name}" + ("; the system does that when memory runs out" if name == "SIGKILL" else "")
