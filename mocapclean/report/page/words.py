"""Ready sentences about a repair, for the methods section of a paper or a log of quality."""

from collections.abc import Mapping
from typing import Any

from mocapclean import __version__
from mocapclean.solvers import SOLVERS

_PROGRAM = "mocapclean"


def citation() -> str:
    """Return how to cite the program."""
    return f"{_PROGRAM} {__version__}, computer software (MIT licence)"


def methods_paragraph(row: Mapping[str, Any]) -> str:
    """Return a paragraph with the numbers, the method, its source and the version; "" for a take without a repair."""
    counts = row.get("counts")
    if not counts or row.get("status") not in ("repaired", "unchanged"):
        return ""
    return " ".join(
        [_untrusted(row, counts), *_filled(row, counts), *_learnt_from(row), *_errors(row), *_bones(row, counts)]
    )


def _untrusted(row: Mapping[str, Any], counts: Mapping[str, int]) -> str:
    seconds = row["frames"] / row["rate"] if row["rate"] else 0.0
    shape = f"{row['markers']} markers, {row['frames']:,} frames at {row['rate']:g} Hz, {seconds:.1f} s"
    if not counts["untrusted"]:
        return f"The take ({shape}) had no missing and no distrusted samples."
    longest = max((gap["length"] for gap in row["gaps"]), default=0)
    share = 100 * counts["untrusted"] / counts["samples"]
    distrusted = counts["untrusted"] - counts["missing"]
    also = f", of which {distrusted:,} were in the file and rejected by trust rules" if distrusted else ""
    return (
        f"Of the {counts['samples']:,} samples of the take ({shape}), {counts['untrusted']:,} ({share:.2f} %) in "
        f"{len(row['gaps']):,} gaps of up to {longest:,} frames ({longest / row['rate']:.2f} s) were missing{also}."
    )


def _filled(row: Mapping[str, Any], counts: Mapping[str, int]) -> list[str]:
    if not counts["untrusted"]:
        return []
    method = row["method"]
    source = SOLVERS[method].REFERENCE if method in SOLVERS else ""
    sentences = [
        f"{counts['filled']:,} samples were reconstructed with the method {method} of {_PROGRAM} {__version__}"
        + (f" ({source.rstrip('.')})." if source else ".")
    ]
    if counts["replaced"]:
        move = f", by up to {row['largest_move']:.1f} mm" if row["largest_move"] is not None else ""
        sentences.append(f"{counts['replaced']:,} of them replaced a measured position{move}.")
    if counts["left"]:
        sentences.append(f"{counts['left']:,} samples were not reconstructed and are missing or as measured.")
    sentences.append("No other sample was changed.")
    return sentences


def _learnt_from(row: Mapping[str, Any]) -> list[str]:
    learnt = row.get("learnt_from") or []
    names = ", ".join(f"{each['source']} (SHA-256 {each['sha256']})" for each in learnt)
    return [f"The method also learnt from other takes of the subject: {names}."] if learnt else []


def _errors(row: Mapping[str, Any]) -> list[str]:
    sentences = []
    total = (row.get("self_check") or {}).get("total") or {}
    if total.get("error"):
        error = total["error"]
        sentences.append(
            f"The 3D root mean square error was {error['rmse_3d']:.2f} mm (largest {error['largest']:.1f} mm) on "
            f"{error['samples']:,} measured samples that were hidden from the method in the pattern of the gaps."
        )
    expected = [gap["expected_3d"] for gap in row["gaps"] if gap["expected_3d"] is not None and gap["samples_filled"]]
    if expected:
        sentences.append(f"The expected 3D error of a filled gap was at most {max(expected):.2f} mm.")
    known = (row.get("accuracy") or {}).get("filled")
    if known:
        sentences.append(f"Against the reference the 3D root mean square error was {known['rmse_3d']:.2f} mm.")
    return sentences


def _bones(row: Mapping[str, Any], counts: Mapping[str, int]) -> list[str]:
    lengths = (row.get("bones") or {}).get("skeleton_rmse") or {}
    if lengths.get("before") is None or lengths.get("after") is None or not counts["filled"]:
        return []
    number = len(row["bones"]["lengths"])
    kind = "bones of the skeleton" if row["bones"]["from"] == "skeleton" else "rigid pairs of markers"
    before, after = lengths["before"], lengths["after"]
    return [f"The lengths of {number} {kind} were {before:.2f} mm off (RMS) before and {after:.2f} mm after."]
