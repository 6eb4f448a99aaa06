"""The frames of a take that are judged and repaired: all of them, or those that ``frames`` or ``events`` name."""

from collections import Counter
from dataclasses import replace

from mocapclean import formats
from mocapclean.config.ranges import event_names, frame_limits
from mocapclean.config.settings import Settings
from mocapclean.errors import UsageError
from mocapclean.take import Event, Finding, Take


def chosen_frames(take: Take, settings: Settings) -> slice:
    """Return the frames of a take, as it was read, that the settings name, as indices.

    Raises UsageError for frames that the take does not have, and for events that its file does not state.
    """
    if settings.events is not None:
        return _between_events(take, *event_names(settings.events))
    if settings.frames is None:
        return slice(0, len(take.trusted))
    first, last = frame_limits(settings.frames)
    start = 0 if first is None else max(first - take.first_frame, 0)
    stop = len(take.trusted) if last is None else min(last + 1 - take.first_frame, len(take.trusted))
    if start >= stop:
        has = "{} to {}".format(*take.numbers(0, len(take.trusted)))
        raise UsageError(f"{_source(take)}: --frames must name frames of the take, {has}. Got {settings.frames}.")
    return slice(start, stop)


def within(take: Take, frames: slice) -> Take:
    """Return a take with these frames alone, and with its findings about them; their spans are cut to the frames."""
    return replace(take.crop(frames.start, frames.stop), findings=tuple(_cut(take.findings, frames)))


def touching(findings: tuple[Finding, ...], frames: slice) -> tuple[Finding, ...]:
    """Return the findings about any of these frames, and those about the whole take."""
    return tuple(f for f in findings if f.frames is None or (f.frames[0] < frames.stop and f.frames[1] > frames.start))


def _cut(findings: tuple[Finding, ...], frames: slice) -> list[Finding]:
    """Return the findings about these frames, with spans that begin at the first of them."""
    shifted = []
    for finding in touching(findings, frames):
        if finding.frames is not None:
            start, stop = max(finding.frames[0], frames.start), min(finding.frames[1], frames.stop)
            finding = replace(finding, frames=(start - frames.start, stop - frames.start))
        shifted.append(finding)
    return shifted


def _between_events(take: Take, start: str, end: str) -> slice:
    """Return the frames from the first event of a name to the next one of another name, both inclusive."""
    events = formats.events(take)
    stated = Counter(event_name(event) for event in events)
    has = ", ".join(f"{name} ({number})" for name, number in stated.items())
    if not events:
        raise UsageError(f"{_source(take)}: --events must go with a file that has events. It has none.")
    for name in (start, end):
        if not _called(name, events):
            raise UsageError(f"{_source(take)}: --events must name events of the file. Got {name!r}; it has: {has}.")
    first = _called(start, events)[0]
    later = [event for event in _called(end, events) if event.frame > first.frame]
    if not later:
        number = _index(first) + take.first_frame
        message = f"an event {end!r} must follow the first {start!r}, in frame {number}. The file has: {has}."
        raise UsageError(f"{_source(take)}: {message}")
    return slice(_index(first), _index(later[0]) + 1)


def _called(name: str, events: tuple[Event, ...]) -> list[Event]:
    """Return the events of a name, in any case: their context and label, such as "Left Foot Strike"."""
    return [event for event in events if event_name(event).casefold() == name.casefold()]


def event_name(event: Event) -> str:
    """Return the name of an event: its context, if it has one, and its label."""
    return f"{event.context} {event.label}".strip()


def _index(event: Event) -> int:
    """Return the index of the frame nearest to an event."""
    return int(event.frame + 0.5)


def _source(take: Take) -> str:
    """Return the path of a take's file."""
    return str(take.origin.path) if take.origin else "take"
