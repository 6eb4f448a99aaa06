"""Lines of the logger ``mocapclean`` about what is done to a take: an event and its values, as ``key=value``.

A line is logged only where the module ``logging`` is loaded, because nobody can listen without it; so a command without
``-v`` does not load it. A record has its line as message, its event as ``event`` and its values as ``values``.
"""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import localtime, perf_counter, strftime
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from logging import Handler, Logger, LogRecord

NAME = "mocapclean"
"""The name of the only logger."""
INFO, DEBUG = 20, 10
"""The levels of the module ``logging`` for steps, and for their details."""

_shown_level = 0
_take: dict[str, str] = {}


def event(name: str, /, **values: Any) -> None:
    """Log a step, such as ``event=read file=walk.c3d frames=480``; a value of None is left out."""
    _log(INFO, name, values)


def detail(name: str, /, **values: Any) -> None:
    """Log a detail of a step."""
    _log(DEBUG, name, values)


@contextmanager
def timed(name: str, /, **values: Any) -> Iterator[dict[str, Any]]:
    """Log a step with its seconds when the block has ended without an error; the block may add values."""
    started = perf_counter()
    yield values
    event(name, **{**values, "seconds": round(perf_counter() - started, 3)})


@contextmanager
def about(take: Any) -> Iterator[None]:
    """Add the name of a take to each line inside the block, so that lines of many takes can be told apart."""
    global _take
    before, _take = _take, {"take": str(take)}
    try:
        yield
    finally:
        _take = before


def details_are_wanted() -> bool:
    """Whether details are logged, for what takes time to put together."""
    logger = _logger()
    return logger is not None and logger.isEnabledFor(DEBUG)


def show(level: int) -> None:
    """Write the lines of this process from a level on to standard error, until it ends."""
    import logging

    global _shown_level
    logger = logging.getLogger(NAME)
    logger.addHandler(_handler())
    logger.setLevel(level)
    _shown_level = level


@contextmanager
def shown(level: int) -> Iterator[None]:
    """Write the lines inside the block from a level on to standard error."""
    import logging

    global _shown_level
    logger = logging.getLogger(NAME)
    before, handlers = logger.level, logger.handlers[:]
    show(level)
    try:
        yield
    finally:
        logger.handlers[:] = handlers
        logger.setLevel(before)
        _shown_level = 0


def shown_level() -> int:
    """Return the level that ``show`` was given, for a further process; 0 where nothing is shown."""
    return _shown_level


def _logger() -> "Logger | None":
    """Return the logger, quiet unless somebody listens; None where the module ``logging`` is not loaded."""
    logging = sys.modules.get("logging")
    if logging is None:
        return None
    logger: Logger = logging.getLogger(NAME)
    if not logger.handlers:
        logger.addHandler(logging.NullHandler())
    return logger


def _log(level: int, name: str, values: dict[str, Any]) -> None:
    logger = _logger()
    if logger is not None and logger.isEnabledFor(level):
        known = {key: value for key, value in {**_take, **values}.items() if value is not None}
        line = " ".join(f"{key}={_text(value)}" for key, value in {"event": name, **known}.items())
        logger.log(level, "%s", line, extra={"event": name, "values": known})


def _text(value: Any) -> str:
    """Return a value as one word, or in quotation marks as JSON where it is empty or more than a word."""
    if isinstance(value, float):
        return f"{value:.6g}"
    text = str(value).lower() if isinstance(value, bool) else str(value)
    is_word = text and text.isprintable() and not any(c in ' "=' for c in text)
    return text if is_word else json.dumps(text)


def _handler() -> "Handler":
    """Return a handler that writes time, level and process before each line, to what is standard error by then."""
    import logging

    class Lines(logging.Handler):
        def emit(self, record: "LogRecord") -> None:
            moment = f"{strftime('%Y-%m-%dT%H:%M:%S', localtime(record.created))}.{int(record.msecs):03d}"
            source = f"level={record.levelname.lower()} process={record.process}"
            sys.stderr.write(f"time={moment} {source} {record.getMessage()}\n")

    return Lines()
