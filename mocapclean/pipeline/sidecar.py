"""Write a repaired take as a NumPy .npz file: positions, status of every sample, standard deviations."""

from pathlib import Path

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.files import new_file
from mocapclean.take import Take
from mocapclean.take.status import Codes, Status, first_rules, supplied


def save(path: Path, before: Take, after: Take, codes: Codes, sd: Floats | None, method: str) -> None:
    """Write one take as .npz, without pickles, complete or not at all.

    before: the take with the trust that detection left. after: the take as it was written. codes: (F, M) the status of
    every sample. sd: (F, M) mm, or None if the method gives none.

    The file holds markers (M,), rate (Hz), first_frame and method. positions (F, M, 3) are mm, NaN where a sample is
    missing still. status (F, M) are codes into status_names. rule (F, M) is the first rule that distrusts a sample, as
    an index into rule_names. sd (F, M) is mm per coordinate, NaN for all but supplied samples. Raises FormatError when
    the file cannot be written.
    """
    by_method = supplied(codes)
    missing_still = before.distrusted_by("missing") & ~by_method
    rule, rule_names = first_rules(before)
    with new_file(path) as part, part.open("wb") as file:
        np.savez(
            file,
            markers=np.array(after.markers, dtype=np.str_),
            rate=np.float64(after.rate),
            first_frame=np.int64(after.first_frame),
            positions=np.where(missing_still[..., None], np.nan, after.positions),
            status=codes,
            status_names=np.array([status.code for status in Status]),
            rule=rule,
            rule_names=np.array(rule_names),
            sd=np.full(codes.shape, np.nan) if sd is None else np.where(by_method, sd, np.nan),
            method=np.array(method),
        )
