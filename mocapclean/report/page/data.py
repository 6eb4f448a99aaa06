"""The data of one take in a page: its row of the report, and the arrays of its view."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mocapclean.files import new_file
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.pipeline.view import View
from mocapclean.report.page.packing import DEGREE_STEP, MILLIMETRE_STEP, Packer
from mocapclean.take.status import first_rules, supplied

_IN_FILE, _IN_OUTPUT = 1, 2  # bits of the array "known"
_AXES = "XYZ"


def take_data(row: Mapping[str, Any], view: View | None) -> str:
    """Return the data of a take as text: its row of the report and, where there is a view, its arrays.

    Arrays: codes, rules and known (which of file and output has a sample) are bytes (M, F). after holds the positions
    of the output, (3 M, F), and changed and before the samples in which the input differs. sd are the bars of supplied
    samples in their order. angles are the channels of a skeleton after, and turned and turned_before where they were
    different.
    """
    packer = Packer()
    header: dict[str, Any] = {"row": dict(row), "view": None}
    if view is not None:
        header["view"] = _view(packer, view, row)
    return packer.text(header)


def write_take(path: Path, row: Mapping[str, Any], view: View | None) -> None:
    """Write the data of a take as a script, because a page from a file may load scripts but may read no data."""
    with new_file(path) as part:
        part.write_text(f'mocapcleanTakes["{path.stem}"]="{take_data(row, view)}";\n', encoding="ascii", newline="\n")


def _view(packer: Packer, view: View, row: Mapping[str, Any]) -> dict[str, Any]:
    """Add the arrays of a view; return its names and numbers."""
    n_frames = len(view.codes)
    rule, rule_names = first_rules(view.before)
    in_file, in_output = view.in_file, view.in_output
    known = np.where(in_file, _IN_FILE, 0) | np.where(in_output, _IN_OUTPUT, 0)
    packer.add_codes("codes", view.codes)
    packer.add_codes("rules", rule)
    packer.add_codes("known", known.astype(np.uint8))
    stored = np.where(in_output[..., None], view.after.positions, np.nan)
    stored = np.where((in_file & ~in_output)[..., None], view.before.positions, stored)
    packer.add_series("after", stored.reshape(n_frames, -1), MILLIMETRE_STEP)
    differs = in_file & in_output & (view.before.positions != view.after.positions).any(axis=2)
    packer.add_numbers("changed", np.flatnonzero(differs.T), 1.0)
    packer.add_numbers("before", view.before.positions.transpose(1, 0, 2)[differs.T], MILLIMETRE_STEP)
    if view.sd is not None:
        sd = view.sd.T[supplied(view.codes).T]
        packer.add_numbers("sd", np.where(np.isfinite(sd), sd, -MILLIMETRE_STEP), MILLIMETRE_STEP)
    columns = {name: column for column, name in enumerate(view.before.markers)}
    return {
        "markers": list(view.before.markers),
        "rules": list(rule_names),
        "events": [{"label": e.label, "context": e.context, "frame": round(e.frame, 3)} for e in view.events],
        "neighbours": view.neighbours(),
        "up": view.up_axis(),
        "links": [
            [columns[bone["start"]], columns[bone["end"]], round(bone["reference"], 3)]
            for bone in row.get("bones", {}).get("lengths", ())
            if bone["start"] in columns and bone["end"] in columns
        ],
        "channels": _angles(packer, view),
        "parents": _parents(view.before.skeleton),
    }


def _parents(skeleton: Skeleton | None) -> dict[str, str]:
    """Return the name of each joint's parent, for joints that have one."""
    if skeleton is None:
        return {}
    pairs = zip(skeleton.names, skeleton.parents, strict=True)
    return {name: skeleton.names[parent] for name, parent in pairs if parent >= 0}


def _angles(packer: Packer, view: View) -> list[dict[str, Any]]:
    """Add the channels of a skeleton before and after; return joint, axis and unit of each, and whether it changed."""
    skeleton: Skeleton | None = view.before.skeleton
    if skeleton is None or view.poses is None:
        return []
    before, after = view.poses
    packer.add_series("angles", after, DEGREE_STEP)
    packer.add_codes("angles_known", np.isfinite(after).astype(np.uint8))
    differs = (before != after) & np.isfinite(before) & np.isfinite(after)
    packer.add_numbers("turned", np.flatnonzero(differs.T), 1.0)
    packer.add_numbers("turned_before", before.T[differs.T], DEGREE_STEP)
    packer.add_codes("angles_in_file", np.isfinite(before).astype(np.uint8))
    return [
        {
            "joint": skeleton.names[channel.joint],
            "changed": bool(differs[:, number].any()),
            "axis": _AXES[channel.axis],
            "unit": "degrees" if channel.is_rotation else "mm",
        }
        for number, channel in enumerate(skeleton.channels)
    ]
