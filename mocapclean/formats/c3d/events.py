"""The events of a C3D file, such as foot strikes.

Source: the C3D file format user guide (Motion Lab Systems, 2008, c3d.org), chapter on the EVENT group.
"""

import math

from mocapclean.formats.c3d.document import C3dDocument
from mocapclean.formats.c3d.header import read_header
from mocapclean.take import Event, Take

SECONDS_PER_MINUTE = 60.0
"""By definition."""


def events(take: Take) -> tuple[Event, ...]:
    """Return the events of a take's file in the order of their times; none where they are not in its frames.

    EVENT:TIMES holds minutes and seconds of each event, counted from frame 1 of the trial at time 0.
    """
    document = take.origin.document if take.origin else None
    if not isinstance(document, C3dDocument):
        return ()
    parameters = read_header(document.path).parameters
    times = parameters.numbers("EVENT:TIMES")
    labels, contexts = (parameters.strings(f"EVENT:{name}") for name in ("LABELS", "CONTEXTS"))
    found = []
    for number, (minutes, seconds) in enumerate(zip(times[0::2], times[1::2], strict=False)):
        # Frame 1 is at time 0, so that a time t is in frame t * rate + 1 of the file.
        frame = (minutes * SECONDS_PER_MINUTE + seconds) * take.rate + 1 - take.first_frame
        if math.isfinite(frame) and 0 <= round(frame) < len(take.trusted):
            label = labels[number] if number < len(labels) else ""
            context = contexts[number] if number < len(contexts) else ""
            found.append(Event(label=label, context=context, frame=frame))
    return tuple(sorted(found, key=lambda event: event.frame))
