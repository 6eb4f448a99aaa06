"""Work that fails in every way, for the tests of the pool; it must be importable where it is done."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mocapclean.errors import SolverError


@dataclass(frozen=True)
class Act:
    """Do what a job says, and keep notes in a folder of what was begun and undone."""

    folder: Path

    def __call__(self, job):
        """The job's number, if all goes well."""
        number, act = job
        (self.folder / f"begun {number}").touch()
        getattr(self, act)(number)
        return number * 10

    def undo(self, job):
        """Make a note."""
        (self.folder / f"undone {job[0]}").touch()

    def work(self, number):
        """Go well, in a moment."""
        time.sleep(0.02)

    def rest(self, number):
        """Take a second."""
        time.sleep(1)

    def hang(self, number):
        """Never end, and hear nothing."""
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        time.sleep(600)

    def die(self, number):
        """Be killed."""
        os.kill(os.getpid(), signal.SIGKILL)

    def crash(self, number):
        """Break as native code does."""
        os.kill(os.getpid(), signal.SIGSEGV)

    def leave(self, number):
        """End the process."""
        os._exit(7)

    def refuse(self, number):
        """Fail as a solver does."""
        raise SolverError("no answer.")

    def err(self, number):
        """Fail as nothing should."""
        raise KeyError("x")

    def devour(self, number):
        """Want a gibibyte."""
        np.ones(1 << 30, dtype=np.uint8)
