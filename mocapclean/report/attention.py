"""How much a take needs a person, and why, in words."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

Row = Mapping[str, Any]

FIRST, SECOND, NONE = "look first", "look", "fine"
LEVELS = (FIRST, SECOND, NONE)
"""The levels, from the one that needs a person most."""

_SENTENCES = 3  # most reasons of a take in words; chosen by hand, so that they are read
_NAME = 40  # most characters of a name in a reason; chosen by hand
# Points of one reason; only their order counts. Chosen by hand: what is not known comes before what may be wrong.
_FAILED, _BREACH, _ERROR, _LEFT, _INEXACT = 1e6, 1e5, 5e4, 1e4, 5e3
_REPLACED, _SUSPICIOUS, _BONES, _FAIR, _WARNING = 100.0, 50.0, 50.0, 10.0, 5.0
_FIRST_FROM = 1e3  # points from which a take is to be looked at first
_FAIR_ERROR = 10.0  # mm, 3D error on hidden samples from which a fill is inexact: the limit of the grade fair
_BONE_GROWTH = 1.2  # how many times worse the bones may be after a fill than before; chosen by hand
_SMALLEST_GROWTH = 0.5  # mm, the least growth that counts; chosen by hand


@dataclass(frozen=True)
class Attention:
    """How much a take needs a person: the level, the points by which takes are sorted, and the reasons in words."""

    level: str
    points: float
    reasons: tuple[str, ...]


def attention(row: Row) -> Attention:
    """Return how much a take of a report, by its row, needs a person."""
    found = sorted(_reasons(row), key=lambda reason: -reason[0])
    points = sum(reason[0] for reason in found)
    level = FIRST if points >= _FIRST_FROM else SECOND if points >= _FAIR else NONE
    return Attention(level, points, tuple(reason[1] for reason in found[:_SENTENCES]))


def _reasons(row: Row) -> Iterator[tuple[float, str]]:
    """Yield the points and the sentence of everything about a take that a person may have to look at."""
    if row.get("status") in ("failed", "skipped"):
        yield _FAILED, str(row["error"]).removeprefix(str(row["source"])).lstrip(":, ")
        return
    for breach in row.get("breaches", ()):
        yield _BREACH, str(breach["message"])
    if row.get("error"):
        yield _BREACH, str(row["error"])
    yield from _of_findings(row)
    if row.get("counts"):
        yield from _of_samples(row, row["counts"])
    yield from _of_bones(row)


def _of_samples(row: Row, counts: Mapping[str, int]) -> Iterator[tuple[float, str]]:
    gaps = row["gaps"]
    if counts["left"]:
        left = [gap for gap in gaps if gap["samples_filled"] < gap["length"]]
        worst = max(left, key=lambda gap: gap["length"] - gap["samples_filled"])
        why = f", {worst['left_because']}" if worst["left_because"] else ""
        share = counts["left"] / counts["samples"]
        if row.get("method"):
            yield _LEFT * (1 + 9 * share), f"{_count(counts['left'], 'sample')} left; longest {_place(worst)}{why}"
        else:  # nothing was to be filled
            yield (
                _FAIR * (1 + 9 * share),
                f"{_count(counts['left'], 'sample')} not trusted; longest gap {_place(worst)}",
            )
    if counts["replaced"]:
        worst = max(gaps, key=lambda gap: gap["largest_move"] or 0.0)
        move = worst["largest_move"] or 0.0
        yield (
            _REPLACED + min(move, _REPLACED),
            f"{_count(counts['replaced'], 'measured sample')} replaced, by up to {move:.1f} mm at {_place(worst)}",
        )
    doubtful = [gap for gap in gaps if gap["grade"] in ("fair", "poor") and gap["samples_filled"]]
    if doubtful:
        worst = max(doubtful, key=lambda gap: gap["expected_3d"] or 0.0)
        poor = sum(gap["grade"] == "poor" for gap in doubtful)
        grades = f"{_count(len(doubtful), 'gap')} filled fair" + (f" or poor ({poor} poor)" if poor else "")
        worst_error = f"{worst['expected_3d']:.1f} mm expected at {_place(worst)}"
        yield _FAIR + len(doubtful) + (_INEXACT if poor else 0.0), f"{grades}; {worst_error}"
    total = ((row.get("self_check") or {}).get("total") or {}).get("error")
    if total and total["rmse_3d"] > _FAIR_ERROR and counts["filled"]:
        yield _INEXACT, f"the self-check found an error of {total['rmse_3d']:.1f} mm in 3D on hidden samples"


def _of_findings(row: Row) -> Iterator[tuple[float, str]]:
    findings = row.get("findings", ())
    for finding in _of_level(findings, "error"):
        yield _ERROR, str(finding["message"]).rstrip(".")
    suspicions = [finding for finding in findings if finding["suspicion"]]
    if suspicions:
        rules = ", ".join(f"{rule} {number}" for rule, number in Counter(f["rule"] for f in suspicions).most_common())
        first = next((f for f in suspicions if f["marker"]), None)
        where = f", first {_place(first)}" if first else ""
        yield (
            _SUSPICIOUS + len(suspicions),
            f"{_count(len(suspicions), 'suspicion')} ({rules}){where}; left as measured",
        )
    for finding in _of_level(findings, "warning"):
        if finding["marker"] is None:
            yield _WARNING + _FAIR, str(finding["message"]).rstrip(".")


def _of_level(findings: Iterable[Row], level: str) -> list[Row]:
    return [finding for finding in findings if finding["level"] == level and not finding["suspicion"]]


def _of_bones(row: Row) -> Iterator[tuple[float, str]]:
    lengths = (row.get("bones") or {}).get("skeleton_rmse") or {}
    before, after = lengths.get("before"), lengths.get("after")
    if before is not None and after is not None and after > max(_BONE_GROWTH * before, before + _SMALLEST_GROWTH):
        yield _BONES, f"bones are {after:.2f} mm off their lengths after, {before:.2f} mm before"


def _place(place: Row) -> str:
    """Return the marker and the frames of a gap or a finding."""
    marker = str(place["marker"])
    marker = marker if len(marker) <= _NAME else f"{marker[: _NAME - 1]}…"
    if place["first"] is None:
        return marker
    frames = f"{place['first']}-{place['last']}" if place["last"] != place["first"] else f"{place['first']}"
    return f"{marker} {frames}"


def _count(number: int, word: str) -> str:
    return f"{number:,} {word}{'' if number == 1 else 's'}"
