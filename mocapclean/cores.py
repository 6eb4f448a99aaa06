"""Share independent parts of the work on one take among the cores of the machine.

The parts do not depend on the number of cores, so that the results do not depend on it either.
"""

import multiprocessing
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

Part = TypeVar("Part")
Result = TypeVar("Result")

# A forked process begins at once with all data of its parent; one that is spawned imports and receives everything anew.
_START = "fork" if sys.platform == "linux" else "spawn"
_LEAST_PARTS = {"fork": 2, "spawn": 12}[_START]
"""Parts from which starting processes pays: about 0.1 s of work each, against 0.02 s and 1 s; chosen by hand."""

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

    The function must not change anything outside, because the changes would be lost.
    """
    workers = min(_cores, len(parts))
    if workers < 2 or len(parts) < _LEAST_PARTS or multiprocessing.current_process().daemon:
        yield from map(function, parts)
        return
    context = multiprocessing.get_context(_START)
    with ProcessPoolExecutor(workers, context, _begin, (function,)) as pool:
        yield from pool.map(_call, parts)


def _begin(function: Callable[[Any], Any]) -> None:
    """Take the function that a worker process is started for."""
    global _function, _cores
    _function, _cores = function, 1


def _call(part: Any) -> Any:
    """Return the result for a part, in a worker process."""
    return _function(part)
