"""The report as JSON; ``docs/report.schema.json`` is its schema."""

import json
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mocapclean import __version__
from mocapclean.evaluation.metrics import GRADES
from mocapclean.json_values import plain
from mocapclean.pipeline.outcome import GapReport, Outcome, Verdict
from mocapclean.take import Finding

SCHEMA = 6  # version of the schema, raised with every change of the report

_STATUSES = ("repaired", "unchanged", "failed", "skipped")
_COUNTS = ("samples", "untrusted", "filled", "replaced", "left", "suspicious")
_TOTALS = ("takes", *_STATUSES, *_COUNTS, "gaps", *GRADES)


def text(rows: Iterable[Mapping[str, Any]], config: Mapping[str, Any]) -> Iterator[str]:
    """Yield the report of a run in parts: versions, the resolved configuration, the row of every take, and totals.

    Only one row is in memory at a time, however many there are.
    """
    head = _json(_head(config))
    yield head.removesuffix("\n}") + ',\n "takes": ['
    totals = dict.fromkeys(_TOTALS, 0)
    separator = "\n"
    for each in rows:
        yield separator + "  " + _json(each).replace("\n", "\n  ")
        separator = ",\n"
        for name, count in _counted(each).items():
            totals[name] += count
    yield '\n ],\n "totals": ' + _json(totals).replace("\n", "\n ") + "\n}\n"


def _head(config: Mapping[str, Any]) -> dict[str, Any]:
    import scipy  # only its version is needed, and only by a report

    versions = {
        "mocapclean": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }
    return {"schema": SCHEMA, "versions": versions, "config": plain(config)}


def checked(verdicts: Sequence[Verdict], config: Mapping[str, Any]) -> str:
    """Return the result of ``check`` as JSON: versions, configuration, breaches and findings of every take, totals."""
    takes = [verdict_row(verdict) for verdict in verdicts]
    passed = sum(verdict.passes for verdict in verdicts)
    totals = {"takes": len(verdicts), "passed": passed, "failed": len(verdicts) - passed}
    return _json({**_head(config), "takes": takes, "totals": totals}) + "\n"


def verdict_row(verdict: Verdict) -> dict[str, Any]:
    """Return the row of one checked take."""
    return {
        "source": str(verdict.source),
        "passes": verdict.passes,
        "seconds": round(verdict.seconds, 3),
        "format": verdict.format,
        "frames": verdict.n_frames,
        "first_frame": verdict.first_frame,
        "judged_frames": _judged(verdict),
        "markers": verdict.n_markers,
        "measures": plain(verdict.measures),
        "breaches": plain(verdict.breaches),
        "findings": [_finding(finding, verdict.first_frame) for finding in verdict.findings],
    }


def line(each: Mapping[str, Any]) -> str:
    """Return the row of one take as a line of JSON in ASCII, under ``takes`` as in a report."""
    return json.dumps({"takes": [each]}, allow_nan=False)


def write(path: Path, rows: Iterable[Mapping[str, Any]], config: Mapping[str, Any]) -> None:
    """Write the report of a run."""
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(text(rows, config))


def _json(value: Any) -> str:
    """Return a value as JSON text, with escapes for bytes of a name that are not UTF-8; raises ValueError for NaN."""
    return _laid_out(value, "\n").encode("utf-8", "backslashreplace").decode()


def _laid_out(value: Any, newline: str) -> str:
    """Return a value as JSON text: a line for each key, and one for each element of a list that has no list of objects.

    newline: a line break and the indentation. Python's own layout takes twice as long, and breaks every list.
    """
    inner = newline + " "
    if isinstance(value, Mapping) and value:
        keys = (f"{json.dumps(key, ensure_ascii=False)}: {_laid_out(each, inner)}" for key, each in value.items())
        return "{" + inner + ("," + inner).join(keys) + newline + "}"
    if isinstance(value, list) and value and isinstance(value[0], Mapping):
        lines = (_laid_out(each, inner) if any(map(_has_objects, each.values())) else _line(each) for each in value)
        return "[" + inner + ("," + inner).join(lines) + newline + "]"
    return _line(value)


def _has_objects(value: Any) -> bool:
    """Whether a value is a list of objects."""
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _line(value: Any) -> str:
    """Return a value as JSON text on one line."""
    return json.dumps(value, allow_nan=False, ensure_ascii=False)


def _counted(each: Mapping[str, Any]) -> dict[str, int]:
    """Return the numbers that a row adds to the totals."""
    counts = each["counts"] or {}
    return {
        "takes": 1,
        **{status: int(each["status"] == status) for status in _STATUSES},
        **{name: counts.get(name, 0) for name in _COUNTS},
        "gaps": len(each["gaps"]),
        **{name: sum(gap["grade"] == name for gap in each["gaps"]) for name in GRADES},
    }


def row(outcome: Outcome) -> dict[str, Any]:
    """Return the row of one take in the report."""
    first = outcome.first_frame
    return {
        "source": str(outcome.source),
        "output": str(outcome.output) if outcome.output else None,
        "sidecar": str(outcome.sidecar) if outcome.sidecar else None,
        "status": outcome.status,
        "exit_code": outcome.exit_code,
        "error": outcome.error,
        "seconds": round(outcome.seconds, 3),
        "sha256": {"source": outcome.source_sha256, "output": outcome.output_sha256},
        "format": outcome.format,
        "frames": outcome.n_frames,
        "first_frame": first,
        "judged_frames": _judged(outcome),
        "markers": outcome.n_markers,
        "rate": outcome.rate,
        "method": outcome.method,
        "choice": plain(outcome.choice),
        "parameters": plain(outcome.parameters),
        "solution": plain(outcome.solution),
        "counts": plain(outcome.counts),
        "largest_move": plain(outcome.largest_move),
        "statuses": {status.code: number for status, number in outcome.statuses.items()},
        "gaps": [_gap(gap, first) for gap in outcome.gaps],
        "findings": [_finding(finding, first) for finding in outcome.findings],
        "accuracy": {
            "reference": str(outcome.reference) if outcome.reference else None,
            "filled": plain(outcome.accuracy),
            "by_marker": plain(outcome.accuracy_by_marker),
            "by_gap_length": plain(outcome.accuracy_by_length),
        },
        "learnt_from": [
            {"source": str(each.path), "sha256": each.sha256, "moved_markers": list(each.moved)}
            for each in outcome.learnt_from
        ],
        "self_check": plain(outcome.self_check),
        "outdated_points": list(outcome.outdated),
        "contacts_broken": None
        if outcome.contacts_broken is None
        else [{"joint": joint, "first": start, "last": stop} for joint, start, stop in outcome.contacts_broken],
        "bones": {
            "from": outcome.bones_from,
            "skeleton_rmse": {"before": outcome.skeleton_rmse[0], "after": outcome.skeleton_rmse[1]},
            "lengths": plain(outcome.bones),
        },
    }


def _judged(result: Outcome | Verdict) -> dict[str, int] | None:
    """Return the first and the last frame that are judged, or None for all of the take."""
    return None if result.judged is None else {"first": result.judged[0], "last": result.judged[1]}


def _gap(gap: GapReport, first: int) -> dict[str, Any]:
    length = gap.stop - gap.start
    return {
        "marker": gap.marker,
        "first": gap.start + first,
        "last": gap.stop - 1 + first,
        "length": length,
        "rules": list(gap.rules),
        "filled": gap.n_filled == length,
        "samples_filled": gap.n_filled,
        "samples_replaced": gap.n_replaced,
        "largest_move": plain(gap.largest_move),
        "status": gap.status.code,
        "left_because": gap.status.sentence,
        "expected_3d": plain(gap.expected),
        "grade": gap.grade or None,
        "error": plain(gap.error),
        "channels": list(gap.channels),
        "expected_degrees": plain(gap.expected_degrees),
        "largest_turn": plain(gap.largest_turn),
        "fitted": plain(gap.fitted),
    }


def _finding(finding: Finding, first: int) -> dict[str, Any]:
    start, stop = finding.frames or (None, None)
    return {
        "rule": finding.rule,
        "level": finding.level,
        "marker": finding.marker,
        "first": None if start is None else start + first,
        "last": None if stop is None else stop - 1 + first,
        "message": finding.message,
        "advice": finding.advice,
        "suspicion": finding.suspicion,
    }
