"""The current stage of the work on a take, for a listener such as a bar on a terminal.

Without a listener, as in a library, a pipe or a worker process, nothing is shown. Each stage is also a detail of the
log.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from mocapclean import logs


class Listener(Protocol):
    """Shows the stage of the work."""

    def stage(self, name: str, total: int) -> None:
        """Begin to show a stage of ``total`` equal steps; 0 for a stage without steps."""

    def advance(self, n: int) -> None:
        """Show that so many more steps are done."""

    def finish(self) -> None:
        """Show no stage until the next one begins."""


_listener: Listener | None = None
_outer = ""


def stage(name: str, total: int = 0) -> None:
    """Begin a stage of the work, such as "filling", of ``total`` equal steps, such as gaps; 0 if not counted."""
    logs.detail("stage", stage=_outer or name, steps=total or None)
    if _listener is not None:
        _listener.stage(_outer or name, total)


def advance(n: int = 1) -> None:
    """Count ``n`` more steps of the stage as done."""
    if _listener is not None:
        _listener.advance(n)


def finish() -> None:
    """Let no stage be shown until the next one begins, as before something is printed."""
    if _listener is not None:
        _listener.finish()


def silence() -> None:
    """Let no stage be shown from now on."""
    global _listener
    finish()
    _listener = None


@contextmanager
def within(name: str) -> Iterator[None]:
    """Begin a stage; inside the block every stage is a part of it, and is shown under its name."""
    global _outer
    stage(name)
    before, _outer = _outer, _outer or name
    try:
        yield
    finally:
        _outer = before


@contextmanager
def shown_by(listener: Listener | None) -> Iterator[None]:
    """Report the stages inside the block to a listener; None for none."""
    global _listener
    before, _listener = _listener, listener
    try:
        yield
    finally:
        _listener = before


def _forget() -> None:
    """Forget the listener: a forked worker must not draw on its parent's terminal."""
    global _listener
    _listener = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
