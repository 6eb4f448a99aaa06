"""Work at one job in a process of its own where a pool cannot be: in a cluster's worker, which may not fork.

python -m mocapclean.batch.alone    reads a pickled job from standard input, writes its answer to standard output
"""

import os
import pickle
import subprocess
import sys
import threading
import time

from mocapclean.batch.limits import Limits, memory_limit
from mocapclean.batch.pool import Answer, Job, Work, attempt, end_of
from mocapclean.errors import MocapcleanError, WorkerError


def alone(work: Work[Job, Answer], job: Job, limits: Limits) -> Answer | MocapcleanError:
    """Do a job within limits of time and memory; how its process was lost, if it was."""
    process = subprocess.Popen(
        [sys.executable, "-m", "mocapclean.batch.alone"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    try:
        said, _ = process.communicate(pickle.dumps((work, job, limits.memory)), timeout=limits.timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return WorkerError(f"it took longer than the limit of {limits.timeout:g} s (--timeout).")
    if process.returncode:
        return WorkerError(f"its process {end_of(process.returncode)}.")
    answer: Answer | MocapcleanError = pickle.loads(said)
    return answer


def _main() -> None:
    parent = os.getppid()
    threading.Thread(target=_follow, args=(parent,), daemon=True).start()
    work, job, memory = pickle.load(sys.stdin.buffer)
    with memory_limit(memory):
        answer = attempt(work, job)
    pickle.dump(answer, sys.stdout.buffer)


def _follow(parent: int) -> None:
    """End with the process that asked."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


if __name__ == "__main__":
    _main()
