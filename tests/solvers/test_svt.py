"""What Tan, Hou & Chau (2015) promise of svt and scsvt on a swinging arm with a known skeleton."""

from dataclasses import replace

import numpy as np
import pytest

from mocapclean.errors import SolverError
from mocapclean.geometry.skeleton import Channel, Skeleton
from mocapclean.simulate import hide
from mocapclean.solvers import scsvt, svt
from mocapclean.solvers.running import run_method
from mocapclean.take import Take

LENGTHS = (400.0, 300.0, 250.0)
NAMES = ("hip", "knee", "ankle", "toe")


def arm(n_frames: int = 90) -> tuple[Take, np.ndarray]:
    """A chain of three bones that swings and drifts, and what is hidden of its last two joints."""
    t = np.arange(n_frames) / 60
    angles = np.stack([np.sin(5 * t), np.sin(7 * t + 1), 1.5 * np.sin(6 * t + 2)])
    bones = [np.stack([np.sin(a), 0.3 * np.cos(3 * a), np.cos(a)], axis=1) for a in angles]
    bones = [n * b / np.linalg.norm(b, axis=1, keepdims=True) for n, b in zip(LENGTHS, bones, strict=True)]
    root = np.stack([600 * t, 80 * np.sin(4 * t), 1000 + 0 * t], axis=1)
    positions = np.stack([root, *(root + np.sum(bones[: k + 1], axis=0) for k in range(3))], axis=1)
    before = np.zeros((4, 3))
    before[1:, 2] = LENGTHS
    skeleton = Skeleton(
        names=NAMES,
        parents=(-1, 0, 1, 2),
        before=before,
        after=np.zeros((4, 3)),
        frames=np.broadcast_to(np.eye(3), (4, 3, 3)),
        channels=tuple(Channel(joint=j, axis=0, is_rotation=True) for j in range(4)),
        product=(0, 1, 2, 3),
    )
    missing = np.zeros((n_frames, 4), dtype=bool)
    missing[30:50, 3] = missing[40:60, 2] = True
    trusted = np.ones((n_frames, 4), dtype=bool)
    return Take(positions=positions, trusted=trusted, markers=NAMES, rate=60.0, skeleton=skeleton), missing


def longest_excess(positions: np.ndarray, missing: np.ndarray) -> float:
    lengths = np.linalg.norm(np.diff(positions, axis=1), axis=2)
    loose = missing[:, 1:] | missing[:, :-1]
    return float((lengths - LENGTHS)[loose].max())


def rmse(solution, truth: Take, missing: np.ndarray) -> float:
    return float(np.sqrt(np.mean((solution.positions - truth.positions)[missing] ** 2)))


def test_bones_are_not_too_long_and_the_error_falls():
    truth, missing = arm()
    take = hide(truth, missing)
    free = run_method("svt", take, svt.Params())
    bound = run_method("scsvt", take, scsvt.Params(bone_tolerance=0.5))
    assert bound.converged
    assert bound.facts["bones_from"] == "skeleton"
    assert longest_excess(free.positions, missing) > 5.0
    assert longest_excess(bound.positions, missing) <= 0.5
    assert rmse(bound, truth, missing) < rmse(free, truth, missing) - 1.0


def test_raw_iterate_misses_the_trusted_samples_by_the_tolerance():
    truth, missing = arm()
    solution = run_method("svt", hide(truth, missing), svt.Params(tolerance=2.0))
    residual = np.sqrt(np.mean((solution.positions - truth.positions)[~missing] ** 2))
    assert 1e-3 < residual <= 2.0
    assert solution.trace[-1] == pytest.approx(residual)


def test_scsvt_reaches_a_tolerance_of_a_millionth_of_the_take():
    take = hide(*arm())
    one, other = (run_method("scsvt", take, scsvt.Params(tolerance=t)) for t in (3e-4, 3e-6))
    assert one.converged
    assert other.converged
    assert other.trace[-1] <= 3e-6
    assert other.facts["excess_mm"] <= 3e-6
    size = np.linalg.norm(other.positions - other.positions.mean(axis=(0, 1)))
    assert np.linalg.norm(one.positions - other.positions) <= 1e-5 * size


def test_bones_that_exclude_each_other_are_named_as_the_reason():
    truth, missing = arm()
    skeleton = replace(truth.skeleton, before=0.5 * truth.skeleton.before)
    inner = np.zeros_like(missing)
    inner[30:50, 2] = True
    take = replace(hide(truth, inner), skeleton=skeleton)
    solution = run_method("scsvt", take, scsvt.Params(tolerance=1e-3))
    assert not solution.converged
    assert "exclude each other" in solution.reason


def test_long_enough_bones_give_svt():
    truth, missing = arm()
    skeleton = replace(truth.skeleton, before=10 * truth.skeleton.before)
    take = replace(hide(truth, missing), skeleton=skeleton)
    tight = {"tolerance": 0.001, "max_iterations": 50000}
    bound = run_method("scsvt", take, scsvt.Params(**tight))
    np.testing.assert_allclose(bound.positions, run_method("svt", take, svt.Params(**tight)).positions, atol=0.5)


def test_smaller_printed_step_takes_twice_the_iterations():
    take = hide(*arm())
    one, half = (run_method("svt", take, svt.Params(iteration="paper", step=step)) for step in (1.5, 0.75))
    assert one.converged
    assert half.iterations == pytest.approx(2 * one.iterations, rel=0.05)
    np.testing.assert_allclose(one.positions, half.positions, atol=3.0)
    assert run_method("svt", take, svt.Params()).iterations < one.iterations / 2


def test_units_do_not_matter_with_a_skeleton():
    take = hide(*arm())
    metres = replace(
        take,
        positions=take.positions / 1000,
        skeleton=replace(take.skeleton, before=take.skeleton.before / 1000),
    )
    default = scsvt.Params()
    names = ("threshold", "tolerance", "bone_tolerance")
    small = run_method("scsvt", metres, scsvt.Params(**{name: getattr(default, name) / 1000 for name in names}))
    np.testing.assert_allclose(small.positions * 1000, run_method("scsvt", take, default).positions, atol=1e-4)


def test_file_origin_is_not_indifferent_to_where_the_world_is():
    take = hide(*arm())
    moved = replace(take, positions=take.positions + 3000.0)
    near, far = (run_method("svt", t, svt.Params(origin="file")).positions for t in (take, moved))
    assert np.abs(far - 3000 - near).max() > 5.0


def test_a_take_without_bones_is_refused_with_advice(rng):
    truth, missing = arm()
    walks = np.cumsum(rng.normal(0, 60, truth.positions.shape), axis=0)
    take = hide(replace(truth, positions=walks, skeleton=None), missing)
    with pytest.raises(SolverError, match=r"scsvt must have bones.*give a skeleton or use svt"):
        run_method("scsvt", take, scsvt.Params())


def test_bones_are_measured_without_a_skeleton_and_hidden_samples_are_not():
    truth, missing = arm()
    take = replace(hide(truth, missing), skeleton=None)
    poisoned = replace(take, positions=np.where(missing[..., None], 1e7, take.positions))
    one, other = (run_method("scsvt", t, scsvt.Params()) for t in (take, poisoned))
    assert one.facts["bones_from"] == "rigid pairs"
    assert one.facts["bones"] >= 3
    assert np.array_equal(one.positions, other.positions)
    assert longest_excess(one.positions, missing) <= 3.5


def test_bones_of_markers_never_trusted_are_left_out():
    truth, missing = arm()
    missing[:, 1] = True
    solution = run_method("scsvt", hide(truth, missing), scsvt.Params())
    assert not solution.filled[:, 1].any()
    assert solution.filled[missing[:, 3], 3].all()
