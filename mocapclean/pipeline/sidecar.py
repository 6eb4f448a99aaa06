"""A repaired take as NumPy arrays beside its file: positions, what became of every sample, and its error bar."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Floats
from mocapclean.files import new_file
from mocapclean.take import Take

STATUS = ("measured", "filled", "left", "distrusted", "moved")
"""Names of the status codes: as the file has it; filled; missing before and after; distrusted, not filled, so that the
file's own value stands; trusted and moved as asked."""


def save(path: Path, before: Take, after: Take, sd: Floats | None, method: str) -> None:
    """Write one take as .npz, without pickles, complete or not at all.

    before: what is trusted; after: the take as it was written; sd: (F, M) mm, or None if the method gives none. The
    file holds markers (M,), rate (Hz), first_frame, positions (F, M, 3) in mm with NaN where a sample is left missing,
    status (F, M) as codes into status_names, sd (F, M) in mm per coordinate with NaN for all but filled samples, and
    method. Raises FormatError when it cannot be written.
    """
    codes = status(before, after)
    bars = np.full(codes.shape, np.nan) if sd is None else np.where(after.filled, sd, np.nan)
    with new_file(path) as part, part.open("wb") as file:
        np.savez(
            file,
            markers=np.array(after.markers, dtype=np.str_),
            rate=np.float64(after.rate),
            first_frame=np.int64(after.first_frame),
            positions=np.where((codes == STATUS.index("left"))[..., None], np.nan, after.positions),
            status=codes,
            status_names=np.array(STATUS),
            sd=bars,
            method=np.array(method),
        )


def status(before: Take, after: Take) -> NDArray[np.uint8]:
    """What became of every sample (F, M), as codes into ``STATUS``."""
    masks = {
        "moved": after.moved,
        "filled": after.filled,
        "measured": before.trusted,
        "left": before.distrusted_by("missing"),
    }
    codes = [np.uint8(STATUS.index(name)) for name in masks]
    return np.select(list(masks.values()), codes, default=np.uint8(STATUS.index("distrusted")))
