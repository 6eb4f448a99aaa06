"""The report as one JSON record; ``docs/report.schema.json`` is its schema."""

import json
import math
import platform
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from mocapclean import __version__
from mocapclean.records import GRADES, Finding, Gap, Outcome

SCHEMA = 2


def record(outcomes: Sequence[Outcome], config: Mapping[str, Any]) -> dict[str, Any]:
    """All that is known of a run: versions, the resolved configuration, every take, and totals."""
    return {
        "schema": SCHEMA,
        "versions": {
            "mocapclean": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        },
        "config": _plain(config),
        "takes": [_take(outcome) for outcome in outcomes],
        "totals": _totals(outcomes),
    }


def to_json(content: Mapping[str, Any]) -> str:
    """The record as text; not-a-number never stands in it."""
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _totals(outcomes: Sequence[Outcome]) -> dict[str, int]:
    grades = Counter(gap.grade for outcome in outcomes for gap in outcome.gaps)
    counts = [outcome.counts for outcome in outcomes if outcome.counts]
    statuses = ("repaired", "unchanged", "failed", "skipped")
    return {
        "takes": len(outcomes),
        **{status: sum(outcome.status == status for outcome in outcomes) for status in statuses},
        **{name: sum(getattr(count, name) for count in counts) for name in ("samples", "untrusted", "filled", "left")},
        "gaps": grades.total(),
        **{name: grades[name] for name in GRADES},
    }


def _take(outcome: Outcome) -> dict[str, Any]:
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
        "markers": outcome.n_markers,
        "rate": outcome.rate,
        "method": outcome.method,
        "choice": _plain(outcome.choice),
        "parameters": _plain(outcome.parameters),
        "solution": _plain(outcome.solution),
        "counts": _plain(outcome.counts),
        "gaps": [_gap(gap, first) for gap in outcome.gaps],
        "findings": [_finding(finding, first) for finding in outcome.findings],
        "accuracy": {
            "reference": str(outcome.reference) if outcome.reference else None,
            "filled": _plain(outcome.accuracy),
            "by_marker": _plain(outcome.accuracy_by_marker),
            "by_gap_length": _plain(outcome.accuracy_by_length),
        },
        "self_check": _plain(outcome.self_check),
        "stored_minus_solved": _plain(outcome.fitting),
        "bones": {
            "from": outcome.bones_from,
            "skeleton_rmse": {"before": outcome.skeleton_rmse[0], "after": outcome.skeleton_rmse[1]},
            "lengths": _plain(outcome.bones),
        },
    }


def _gap(gap: Gap, first: int) -> dict[str, Any]:
    length = gap.stop - gap.start
    return {
        "marker": gap.marker,
        "first": gap.start + first,
        "last": gap.stop - 1 + first,
        "length": length,
        "rules": list(gap.rules),
        "filled": gap.n_filled == length,
        "samples_filled": gap.n_filled,
        "left_because": gap.left_because,
        "expected_3d": _plain(gap.expected),
        "grade": gap.grade or None,
        "error": _plain(gap.error),
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
    }


def _plain(value: Any) -> Any:
    """Dataclasses, paths and NumPy scalars as JSON values; what is not finite becomes null."""
    if is_dataclass(value) and not isinstance(value, type):
        return _plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
