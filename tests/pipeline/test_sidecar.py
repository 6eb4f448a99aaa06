"""The arrays beside a repaired take: they say what the file and the report say, and nothing else."""

from dataclasses import replace

import numpy as np

import mocapclean
from mocapclean.pipeline import sidecar
from mocapclean.pipeline.filling import merge
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method
from mocapclean.take import Take
from mocapclean.take.status import Status, detected, supply


def broken_take() -> Take:
    """Four markers: one whole; one with a gap inside and one at the end; one distrusted by hand; one never seen."""
    rng = np.random.default_rng(2)
    positions = np.cumsum(rng.normal(size=(60, 4, 3)), axis=0)
    trusted = np.ones((60, 4), dtype=bool)
    trusted[20:30, 1] = trusted[55:, 1] = trusted[:, 3] = False
    positions[~trusted] = 0.0
    names = ("whole", "gap", "doubted", "never")
    take = Take(positions=positions, trusted=trusted, markers=names, rate=100.0, first_frame=7)
    take = mocapclean.detect(take, {"missing": None})
    lowered = trusted.copy()
    lowered[40:50, 2] = False
    return replace(take, trusted=lowered)


def repaired(take: Take, wanted: np.ndarray) -> Take:
    return merge(take, run_method("linear", take, SOLVERS["linear"].Params()), wanted)


def status_of(before: Take, after: Take) -> np.ndarray:
    codes = detected(before)
    supply(codes, after.filled)
    return codes


def test_what_is_saved_is_what_is_read(tmp_path):
    before = broken_take()
    after = repaired(before, np.ones_like(before.trusted))
    codes = status_of(before, after)
    sd = np.full(before.trusted.shape, 2.5)
    for name, bars in (("with", sd), ("without", None)):
        sidecar.save(tmp_path / f"{name}.npz", before, after, codes, bars, "linear")
        with np.load(tmp_path / f"{name}.npz", allow_pickle=False) as arrays:
            found = dict(arrays)
        assert tuple(found["markers"]) == after.markers
        assert (float(found["rate"]), int(found["first_frame"]), str(found["method"])) == (100.0, 7, "linear")
        assert found["status"].dtype == np.uint8
        assert np.array_equal(found["status"], codes)
        assert tuple(found["status_names"]) == tuple(status.code for status in Status)
        missing_still = codes == Status.MISSING
        assert np.isnan(found["positions"][missing_still]).all()
        assert np.array_equal(found["positions"][~missing_still], after.positions[~missing_still])
        assert np.isnan(found["sd"][~after.filled]).all()
        assert (found["sd"][after.filled] == 2.5).all() if bars is not None else np.isnan(found["sd"]).all()
        names = found["rule_names"][found["rule"]]
        assert np.array_equal(names == "missing", ~before.trusted & (np.arange(4) != 2))
        assert (names[before.trusted] == "").all()
    assert {path.name for path in tmp_path.iterdir()} == {"with.npz", "without.npz"}


def test_the_same_take_gives_the_same_bytes(tmp_path):
    take = broken_take()
    for name in ("one", "two"):
        sidecar.save(tmp_path / f"{name}.npz", take, take, detected(take), None, "linear")
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
