"""The text of a range of frames in the settings: by frame numbers, or by events."""

import re
from typing import Any

_NUMBERS = re.compile(r"(-?\d+)?:(-?\d+)?")


def frame_limits(text: str) -> tuple[int | None, int | None]:
    """Return the first and the last frame number of "first:last"; None for a side that is open.

    Raises ValueError for any other text, and for a first frame after the last one.
    """
    found = _NUMBERS.fullmatch(text.strip())
    first, last = (None if side is None else int(side) for side in found.groups()) if found else (None, None)
    if (first is None and last is None) or (first is not None and last is not None and first > last):
        raise ValueError("first:last, first: or :last, in frame numbers of the file, such as 100:400")
    return first, last


def event_names(text: str) -> tuple[str, str]:
    """Return the names of the events at the start and at the end of "start:end"; raise ValueError for another text."""
    start, _, end = (part.strip() for part in text.partition(":"))
    if not start or not end:
        raise ValueError("two names of events, such as Left Foot Strike:Left Foot Strike")
    return start, end


class FrameNumbers:
    """A text that ``frame_limits`` understands; part of an annotation."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return _understood(frame_limits, handler(source))


class EventNames:
    """A text that ``event_names`` understands; part of an annotation."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return _understood(event_names, handler(source))


def _understood(understand: Any, schema: Any) -> Any:
    """Return pydantic's schema of a text that a function does not refuse."""
    from pydantic_core import core_schema

    def checked(text: str) -> str:
        understand(text)
        return text

    return core_schema.no_info_after_validator_function(checked, schema)
