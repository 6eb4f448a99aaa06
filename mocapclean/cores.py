"""Share independent parts of the work on one take among the cores of the machine.

The parts do not depend on the number of cores, so that the results do not depend on it either.
"""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from mocapclean.errors import WorkerError

Part = TypeVar("Part")
Result = TypeVar("Result")

# A forked process begins at once with all data of its parent; one that is spawned imports and receives everything anew.
_START = "fork" if sys.platform == "linux" and hasattr(os, "fork") else "spawn"
_LEAST_PARTS = {"fork": 2, "spawn": 24}[_START]
"""Parts from which starting processes pays: a part takes about 0.1 s, a start 0.02 s or 1 s; chosen by hand."""

_cores = 1
_function: Callable[[Any], Any]


@contextmanager
def sharing(cores: int) -> Iterator[None]:
    """Let ``in_parts`` use up to so many cores inside the block."""
    global _cores
    before, _cores = _cores, cores
    try:
        yield
    finally:
        _cores = before


def in_parts(function: Callable[[Part], Result], parts: Sequence[Part]) -> Iterator[Result]:
    """Yield the result of a function for each part, in their order, computed on as many cores as may be used.

    The function must not change anything outside, because the changes would be lost. Raises what the function raises,
    and WorkerError where the system ends one of the processes.
    """
    workers = min(_cores, len(parts))
    if workers < 2 or len(parts) < _LEAST_PARTS:
        yield from map(function, parts)
        return
    # These modules are loaded for a take with many gaps alone.
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor
    from concurrent.futures.process import BrokenProcessPool

    context = multiprocessing.get_context(_START)
    others = multiprocessing.active_children()
    try:
        with ProcessPoolExecutor(workers, context, _begin, (function,)) as pool:
            try:
                yield from pool.map(_call, parts)
            except BaseException:
                # Nobody waits for the parts that still run. A pool whose end is interrupted by a second signal would
                # wait for its processes for ever, so that they are ended first.
                for process in multiprocessing.active_children():
                    if process not in others:
                        process.kill()
                raise
    except BrokenProcessPool:
        message = "a process that worked on a part of the take was ended, as the system does when memory runs out."
        raise WorkerError(f"{message} --workers 1 needs less.") from None


def _begin(function: Callable[[Any], Any]) -> None:
    """Take the function that a worker process is started for. Signals are for the main process."""
    import signal
    import threading

    global _function, _cores
    _function, _cores = function, 1
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this worker process as soon as the main process has ended, even where that was killed."""
    import multiprocessing

    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _call(part: Any) -> Any:
    """Return the result for a part, in a worker process."""
    return _function(part)
