"""What a take shows in a notebook: the map of its samples, and the curves of a gap."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mocapclean.config.settings import DEFAULT_METHOD
from mocapclean.errors import UsageError
from mocapclean.pipeline.filling import answer, merge
from mocapclean.pipeline.view import View
from mocapclean.report import figures
from mocapclean.solvers import SOLVERS
from mocapclean.take import Take
from mocapclean.take.status import current

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def view_of(take: Take) -> View:
    """Return the view of a take in memory; what was filled in it counts as missing before."""
    before = replace(take, positions=np.where(take.filled[..., None], np.nan, take.positions))
    return View(before=before, after=take, codes=current(take))


def plot(take: Take) -> "Figure":
    """Return the map of the samples of a take."""
    figures.require_matplotlib()
    return figures.sheet([view_of(take)], [_caption(take)])


def plot_gap(take: Take, marker: str, frame: int) -> "Figure":
    """Return the curves of a marker around the gap at a frame of the file.

    Where the gap is not filled, the default method fills it for the figure, with the 90 % band; the take is not
    changed. Raises UsageError for a marker or a frame that the take does not have.
    """
    figures.require_matplotlib()
    if marker not in take.markers:
        raise UsageError(f"the marker must be one of the take. Got {marker!r}.")
    index = frame - take.first_frame
    if not 0 <= index < len(take.trusted):
        first, last = take.numbers(0, len(take.trusted))
        raise UsageError(f"the frame must be from {first} to {last}. Got {frame}.")
    column = take.markers.index(marker)
    view = view_of(take)
    if not (take.trusted | take.filled)[index, column]:
        solution = answer(DEFAULT_METHOD, take, SOLVERS[DEFAULT_METHOD].Params(), np.ones_like(take.trusted))
        filled = merge(take, solution, np.ones_like(take.trusted))
        view = View(before=take, after=filled, codes=current(filled), sd=solution.sd)
    return figures.curves(view, marker, figures.around(view, marker, index))


def html(take: Take) -> str:
    """Return a small map of a take with a caption, for a notebook."""
    return figures.small_map(view_of(take), _caption(take))


def _caption(take: Take) -> str:
    n_frames, n_markers = take.trusted.shape
    name = take.origin.path.name if take.origin else "take"
    missing = int((~take.trusted & ~take.filled).sum())
    filled = f", {int(take.filled.sum()):,} filled" if take.filled.any() else ""
    seconds = n_frames / take.rate
    return (
        f"{name}: {n_markers} markers × {n_frames:,} frames, {seconds:.1f} s; {missing:,} samples not trusted{filled}"
    )
