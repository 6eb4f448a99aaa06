"""The bar of a single take: its stage on standard error, where that is a terminal."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from mocapclean import logs, progress


def drawn_bar(**options: Any) -> Any:
    """Return a bar of tqdm on standard error, which is a terminal; 80 by 24 where its size is unknown."""
    from tqdm import tqdm  # needed on terminals alone

    tqdm.monitor_interval = 0  # without a thread of its own, so that a take can be shared among forked processes
    size = os.get_terminal_size(sys.stderr.fileno())
    return tqdm(ncols=size.columns or 80, nrows=size.lines or 24, **options)


@contextmanager
def stages_shown(options: dict[str, Any]) -> Iterator[None]:
    """Show the stages of the work inside the block, from the first moment on, unless the options ask for quiet."""
    if options.get("quiet") or logs.shown_level() or not sys.stderr.isatty():
        yield
        return
    bar = _StageBar()
    try:
        with progress.shown_by(bar):
            progress.stage("starting")
            yield
    finally:
        bar.finish()


class _StageBar:
    """Shows one stage at a time, such as "filling gap 37 of 451"; a finished stage leaves nothing behind."""

    def __init__(self) -> None:
        self._bar: Any = None

    def stage(self, name: str, total: int) -> None:
        """Begin to show a stage, at once."""
        self.finish()
        counted = "{desc} gap {n_fmt} of {total_fmt} |{bar}| {elapsed}"
        layout = counted if total else "{desc} {elapsed}"
        self._bar = drawn_bar(total=total or None, desc=name, bar_format=layout, leave=False, miniters=1)

    def advance(self, n: int) -> None:
        """Show that so many more steps are done."""
        if self._bar is not None:
            self._bar.update(n)

    def finish(self) -> None:
        """Take the bar off the terminal."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None
