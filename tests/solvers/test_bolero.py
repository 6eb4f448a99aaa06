"""What Li et al. (2010) promise: bones of the right length, and DynaMMo where there is none."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import mocapclean
from mocapclean.errors import SolverError
from mocapclean.geometry.skeleton import Skeleton, move
from mocapclean.simulate import block_loss, perform
from mocapclean.solvers import SOLVERS, dynammo
from mocapclean.solvers.bolero import Params
from mocapclean.solvers.running import run_method
from mocapclean.take import Take

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"
LENGTHS = (400.0, 300.0, 200.0, 250.0)


def arm(rng: np.random.Generator, n_frames: int = 240) -> tuple[Take, np.ndarray]:
    """A chain of four bones that swings, with one of its five joints lost in every block of 40 frames."""
    t = np.arange(n_frames)[:, None] / 60
    angles = 1.2 * np.sin(2 * np.pi * t * [0.6, 0.8, 1.1, 0.5] + [0, 1, 2, 3])
    lift = 0.5 * np.cos(2 * np.pi * t * [0.7, 0.4, 0.9, 1.0])
    steps = np.stack([np.cos(angles) * np.cos(lift), np.sin(angles) * np.cos(lift), np.sin(lift)], axis=2)
    truth = np.concatenate([np.zeros((n_frames, 1, 3)), np.cumsum(steps * np.array(LENGTHS)[:, None], axis=1)], axis=1)
    truth += 200 * np.sin(t)[:, None]
    missing = block_loss(n_frames, 5, 40, 1, rng)
    names = tuple("abcde")
    offsets = np.array([[0.0, 0, 0], *([length, 0, 0] for length in LENGTHS)])
    skeleton = Skeleton(
        names=names,
        parents=(-1, 0, 1, 2, 3),
        before=offsets,
        after=np.zeros((5, 3)),
        frames=np.tile(np.eye(3), (5, 1, 1)),
        channels=(),
        product=(),
    )
    positions = np.where(missing[..., None], 0.0, truth)
    return Take(positions=positions, trusted=~missing, markers=names, rate=60.0, skeleton=skeleton), truth


def stretches(take: Take, positions: np.ndarray) -> np.ndarray:
    """Length errors (F, 4) in mm of the bones of the merged take that have a filled end."""
    merged = np.where(take.trusted[..., None], take.positions, positions)
    stretch = np.linalg.norm(np.diff(merged, axis=1), axis=2) - LENGTHS
    return np.abs(stretch)[~(take.trusted[:, 1:] & take.trusted[:, :-1])]


def test_hard_bones_hold_and_soft_ones_tend_to(rng):
    take, _ = arm(rng, 120)
    common = {"states": 6, "max_iterations": 50, "bone_iterations": 10}
    soft = [Params(constraint="soft", bone_weight=weight, **common) for weight in (1e3, 1.0)]
    hard, *softer = (
        stretches(take, run_method("bolero", take, params).positions) for params in (Params(**common), *soft)
    )
    free = stretches(take, run_method("dynammo", take, dynammo.Params(states=6, max_iterations=50)).positions)
    assert hard.max() <= 1e-3
    assert hard.mean() < softer[0].mean() < softer[1].mean() < free.mean()
    assert free.mean() > 1.0


def test_bones_help_a_boxing_figure():
    performance = perform("boxing", 4.0, 60.0)
    truth = move(performance.asf, performance.asf_poses).positions
    missing = block_loss(len(truth), truth.shape[1], 60, 3, np.random.default_rng(7))
    take = Take(
        positions=np.where(missing[..., None], 0.0, truth),
        trusted=~missing,
        markers=performance.asf.names,
        rate=60.0,
        skeleton=performance.asf,
    )
    error = [
        np.sqrt(np.square(run_method(method, take, SOLVERS[method].Params()).positions - truth)[missing].mean())
        for method in ("bolero", "dynammo")
    ]
    assert error[0] < 0.8 * error[1]


def test_without_an_active_bone_it_is_dynammo(rng):
    take, _ = arm(rng)
    trusted = take.trusted.copy()
    trusted[:, 1:] = True
    trusted[20:60, 0], trusted[100:130, 0], trusted[:, 1] = False, False, False
    trusted[0, 1] = True
    lonely = Take(
        positions=take.positions, trusted=trusted, markers=("a", "b", "x", "y", "z"), rate=60.0, skeleton=take.skeleton
    )
    lonely = lonely.select(np.array([0, 2, 3, 4]))
    far = Take(
        positions=lonely.positions,
        trusted=lonely.trusted,
        markers=("q", "c", "d", "e"),
        rate=60.0,
        skeleton=take.skeleton,
    )
    one, other = run_method("bolero", far, Params()), run_method("dynammo", far, dynammo.Params())
    assert one.facts["bones"] == 2
    assert np.array_equal(one.positions[one.filled], other.positions[other.filled])
    assert one.trace == other.trace


def test_the_likelihood_rises_with_the_bones_too(rng):
    take, _ = arm(rng)
    params = Params(state_schedule=(), states=5, max_iterations=60, bone_iterations=30, tolerance=0.0)
    solution = run_method("bolero", take, params)
    free, bound = solution.trace[:30], solution.trace[30:]
    assert len(bound) == 30
    assert all(b >= a - 1e-9 for a, b in pairwise(free))
    assert all(b >= a - 1e-9 for a, b in pairwise(bound[1:]))
    assert solution.reason == "max_iterations 60 reached"


def test_stops_after_so_many_iterations_with_bones(rng):
    take, _ = arm(rng)
    solution = run_method("bolero", take, Params(bone_iterations=2, tolerance=1e-3))
    assert solution.reason == "bone_iterations 2 reached"
    assert not solution.converged


def test_rigid_pairs_stand_in_for_a_skeleton(rng):
    take, _ = arm(rng)
    bare = Take(positions=take.positions, trusted=take.trusted, markers=take.markers, rate=60.0)
    solution = run_method("bolero", bare, Params())
    assert solution.facts["bones_from"] == "rigid pairs"
    assert stretches(bare, solution.positions).max() < 0.1


def test_pairs_of_markers_on_skin_help_and_never_throw_a_marker():
    broken, truth = (mocapclean.read(SAMPLES / f"walk{end}.c3d").crop(100, 340) for end in ("", "_truth"))
    wrong = {}
    for method in ("bolero", "dynammo"):
        miss = run_method(method, broken, SOLVERS[method].Params()).positions - truth.positions
        wrong[method] = np.linalg.norm(miss[~broken.trusted], axis=1)
    assert np.square(wrong["bolero"]).mean() < 0.9 * np.square(wrong["dynammo"]).mean()
    assert wrong["bolero"].max() < 1.1 * wrong["dynammo"].max()


def test_hidden_samples_are_not_measured(rng):
    take, _ = arm(rng)
    lost = np.where(take.trusted[..., None], take.positions, np.nan)
    bare = [Take(positions=p, trusted=take.trusted, markers=take.markers, rate=60.0) for p in (take.positions, lost)]
    one, other = (run_method("bolero", t, Params(max_iterations=30)).positions for t in bare)
    assert np.array_equal(one, other)


def test_refuses_where_no_bone_is_known(rng):
    positions = 100 * rng.normal(size=(50, 4, 3))
    trusted = np.ones((50, 4), dtype=bool)
    trusted[10:20, 2] = False
    with pytest.raises(SolverError, match="bolero must know"):
        run_method("bolero", Take(positions=positions, trusted=trusted, markers=tuple("abcd"), rate=60.0), Params())
