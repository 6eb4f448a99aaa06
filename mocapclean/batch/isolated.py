"""Run one job in a process of its own, for workers of a cluster, which may not fork.

``python -m mocapclean.batch.isolated`` reads a pickled job from standard input and writes its result to standard
output.
"""

import os
import pickle
import subprocess
import sys
import threading
import time

from mocapclean.batch.limits import WorkerLimits, memory_limit
from mocapclean.batch.pool import Job, Result, Work, attempt, exit_description, timeout_error
from mocapclean.errors import MocapcleanError, WorkerError

_PARENT_CHECK_INTERVAL = 0.5
"""Seconds between two checks that the parent still runs; chosen by hand."""


def run_isolated(work: Work[Job, Result], job: Job, limits: WorkerLimits) -> Result | MocapcleanError:
    """Return the result of a job that runs within limits of time and memory, or a WorkerError if its process ended."""
    process = subprocess.Popen(
        [sys.executable, "-m", "mocapclean.batch.isolated"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    try:
        output, _ = process.communicate(pickle.dumps((work, job, limits.memory)), timeout=limits.timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return timeout_error(limits)
    if process.returncode:
        return WorkerError(f"its process {exit_description(process.returncode)}.")
    result: Result | MocapcleanError = pickle.loads(output)
    return result


def _main() -> None:
    """Run the job that standard input holds."""
    parent = os.getppid()
    threading.Thread(target=_exit_with_parent, args=(parent,), daemon=True).start()
    work, job, memory = pickle.load(sys.stdin.buffer)
    with memory_limit(memory):
        result = attempt(work, job)
    pickle.dump(result, sys.stdout.buffer)


def _exit_with_parent(parent: int) -> None:
    """End this process as soon as its parent has ended."""
    while os.getppid() == parent:
        time.sleep(_PARENT_CHECK_INTERVAL)
    os._exit(1)


if __name__ == "__main__":
    _main()
