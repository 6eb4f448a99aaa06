"""The status of every sample: what it is after detection, and what became of it, as one code in an (F, M) array.

Each code is set where its decision is made: by detection, by the request of the user, by the method, by the limits on
the answer, by the writer. The first decision about a sample stands. Reports, counts, gaps and the sidecar read the
codes.
"""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools
from mocapclean.take.take import Take

Codes = NDArray[np.uint8]


class Status(IntEnum):
    """What a sample is, or why it was left as it is; ``code`` is its name in reports."""

    MEASURED = 0
    FILLED = 1
    REPLACED = 2
    MOVED = 3
    MISSING = 4
    DISTRUSTED = 5
    NOT_ASKED_FOR = 6
    TOO_LONG = 7
    NEVER_SEEN = 8
    NOTHING_SEEN = 9
    AT_END = 10
    NO_ANSWER = 11
    TOO_UNCERTAIN = 12
    OUT_OF_RANGE = 13
    NO_POSE = 14
    STORED_AS_MISSING = 15
    POOR = 16
    SUSPICIOUS = 17
    BENDING = 18
    OUTSIDE = 19

    @property
    def code(self) -> str:
        """The name of the status in reports and in the sidecar."""
        return self.name.lower()

    @property
    def sentence(self) -> str:
        """The reason in words why a sample was left, or "" for a sample that nothing left."""
        return _SENTENCES.get(self, "")


MEANINGS = {
    Status.MEASURED: "trusted, as it is in the file",
    Status.FILLED: "missing in the file, supplied by the method",
    Status.REPLACED: "in the file but distrusted, supplied by the method",
    Status.MOVED: "trusted, moved because the user asked for it (denoised, or exchanged back)",
    Status.MISSING: "missing in the file; no method ran",
    Status.DISTRUSTED: "in the file but distrusted; no method ran",
    Status.NOT_ASKED_FOR: "left: of a marker that --markers does not name",
    Status.TOO_LONG: "left: in a gap longer than --max-gap",
    Status.NEVER_SEEN: "left: of a marker that is trusted in no frame",
    Status.NOTHING_SEEN: "left: in a frame in which no marker is trusted",
    Status.AT_END: "left: in a gap at the start or end of the take, for which the method has no answer",
    Status.NO_ANSWER: "left: in a gap for which the method has no answer",
    Status.TOO_UNCERTAIN: "left: in a gap whose expected error is above --max-error",
    Status.OUT_OF_RANGE: "left: the file's numbers do not reach the answer",
    Status.NO_POSE: "left: no pose of the skeleton reaches the answer and keeps the trusted joints",
    Status.STORED_AS_MISSING: "left: the file would store the answer as 0, 0, 0, its mark for a missing sample",
    Status.POOR: "left: in a gap whose expected error is graded poor; --fill-poor fills it",
    Status.SUSPICIOUS: "as it is in the file, although a rule reports it; --replace suspicious fills it",
    Status.BENDING: "left: the answer would change the distance to a rigid partner too much; --fill-poor fills it",
    Status.OUTSIDE: "as it is in the file, outside of --frames or --events: neither judged nor counted",
}

_SENTENCES = {
    Status.NOT_ASKED_FOR: "not asked for",
    Status.TOO_LONG: "longer than the limit",
    Status.NEVER_SEEN: "the marker is never seen",
    Status.NOTHING_SEEN: "nothing is seen in these frames",
    Status.AT_END: "at the end of the take, where the method has no answer",
    Status.NO_ANSWER: "the method has no answer here",
    Status.TOO_UNCERTAIN: "the expected error is above the limit",
    Status.OUT_OF_RANGE: "the file's numbers do not reach so far",
    Status.NO_POSE: "no pose reaches it",
    Status.STORED_AS_MISSING: "the file would store it as a missing sample",
    Status.POOR: "the expected error is graded poor",
    Status.BENDING: "the distance to a rigid partner would change too much",
}

_SUPPLIED = {Status.MISSING: Status.FILLED, Status.DISTRUSTED: Status.REPLACED}


def detected(take: Take) -> Codes:
    """Return the codes (F, M) after detection: measured, suspicious, moved, missing or distrusted."""
    untrusted = np.where(take.distrusted_by("missing"), Status.MISSING, Status.DISTRUSTED)
    in_file = np.where(take.suspicious, Status.SUSPICIOUS, Status.MEASURED)
    trusted = np.where(take.moved, Status.MOVED, in_file)
    return np.where(take.trusted, trusted, untrusted).astype(np.uint8)


def leave_outside(codes: Codes, inside: Bools) -> None:
    """Give all samples of the frames that are not ``inside`` (F,) the status of samples outside, in place."""
    codes[~inside] = Status.OUTSIDE


def counted(codes: Codes) -> Bools:
    """Return which samples (F, M) are judged and counted: those of the frames inside."""
    return np.asarray(codes != Status.OUTSIDE)


def current(take: Take) -> Codes:
    """Return the codes (F, M) of a take in memory: those after detection, and what has been filled since."""
    codes = detected(take)
    supply(codes, take.filled & ~take.trusted)
    return codes


def undecided(codes: Codes) -> Bools:
    """Return which samples (F, M) are missing or distrusted without a decision about them."""
    return np.asarray((codes == Status.MISSING) | (codes == Status.DISTRUSTED))


def decide(codes: Codes, where: Bools, status: Status) -> None:
    """Give the undecided samples ``where`` (F, M) a status, in place."""
    codes[where & undecided(codes)] = status


def supply(codes: Codes, where: Bools) -> None:
    """Mark the undecided samples ``where`` (F, M) as filled if they were missing, else as replaced, in place."""
    for before, after in _SUPPLIED.items():
        codes[where & (codes == before)] = after


def supplied(codes: Codes) -> Bools:
    """Return which samples (F, M) a method supplied."""
    return np.asarray((codes == Status.FILLED) | (codes == Status.REPLACED))


def withdraw(codes: Codes, where: Bools, status: Status) -> None:
    """Give the supplied samples ``where`` (F, M), which the file could not take, a status, in place."""
    codes[where & supplied(codes)] = status


def first_rules(take: Take) -> tuple[Codes, tuple[str, ...]]:
    """Return for each sample (F, M) the first rule that distrusts it, as an index into the names that are returned.

    Index 0 is the empty name of trusted samples; "missing" and "user" count as rules.
    """
    names = ("", *dict.fromkeys(finding.rule for finding in take.findings if finding.frames))
    indices = np.zeros(take.trusted.shape, dtype=np.uint8)
    for index, name in reversed(list(enumerate(names))[1:]):
        indices[take.distrusted_by(name) & ~take.trusted] = index
    return indices, names
