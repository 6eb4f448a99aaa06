import numpy as np
import pytest

from mocapclean.simulate import block_loss, hide, occlude
from mocapclean.solvers import spline
from mocapclean.solvers.fillable import fillable
from mocapclean.solvers.kriging import Params
from mocapclean.solvers.kriging.gap_splitting import split_gap
from mocapclean.solvers.kriging.take_state import TakeState
from mocapclean.solvers.running import run_method
from mocapclean.take import Take

RATE = 120.0


def body(n_frames: int = 600, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """(F, 15, 3) mm: three segments of five markers, chained by turning joints, that travel and turn."""
    rng = np.random.default_rng(seed)
    t = np.arange(n_frames) / RATE
    place = np.stack([900 * np.sin(0.7 * t), 700 * np.cos(0.5 * t), 900 + 30 * np.sin(6 * t)], axis=1)
    heading = 0.9 * t + 0.4 * np.sin(2 * t)
    parts = []
    for segment in range(3):
        cos, sin = np.cos(heading), np.sin(heading)
        axes = np.stack([np.stack([cos, -sin, 0 * t], 1), np.stack([sin, cos, 0 * t], 1)], axis=1)
        axes = np.concatenate([axes, np.broadcast_to([[[0.0, 0, 1]]], (n_frames, 1, 3))], axis=1)
        local = rng.normal(size=(5, 3)) * 80
        parts.append(place[:, None] + np.einsum("fij,mj->fmi", axes, local))
        place = place + np.einsum("fij,j->fi", axes, [250.0, 0, -150])
        heading = heading + 0.8 * np.sin((2.1 + segment) * t)
    return np.concatenate(parts, axis=1) + noise * rng.normal(size=(n_frames, 15, 3))


def take_of(positions: np.ndarray, missing: np.ndarray | None = None) -> Take:
    names = tuple(f"m{k}" for k in range(positions.shape[1]))
    take = Take(positions=positions, trusted=np.ones(positions.shape[:2], bool), markers=names, rate=RATE)
    return take if missing is None else hide(take, missing)


def missing_of(spans: list[tuple[int, int, int]], n_frames: int = 600) -> np.ndarray:
    missing = np.zeros((n_frames, 15), dtype=bool)
    for marker, start, stop in spans:
        missing[start:stop, marker] = True
    return missing


def rms(differences: np.ndarray) -> float:
    return float(np.sqrt(np.mean(differences**2)))


def test_a_marker_of_a_rigid_segment_comes_back_to_its_noise():
    truth = body(noise=0.3)
    missing = missing_of([(1, 100, 220), (8, 300, 360)])
    solution = run_method("kriging", take_of(truth, missing), Params())
    assert rms((solution.positions - truth)[missing]) < 0.5
    assert 0.5 < rms((solution.positions - truth)[missing] / solution.sd[missing][:, None]) < 1.5


def test_a_whole_segment_lost_is_bridged_with_a_larger_sd():
    truth = body(noise=0.02)
    missing = missing_of([(k, 200, 230) for k in range(10, 15)])
    alone = missing_of([(12, 200, 230)])
    solution = run_method("kriging", take_of(truth, missing), Params())
    assert solution.filled[missing].all()
    assert rms((solution.positions - truth)[missing]) < rms(
        (run_method("spline", take_of(truth, missing), spline.Params()).positions - truth)[missing]
    )
    assert solution.sd[missing].mean() > 3 * run_method("kriging", take_of(truth, alone), Params()).sd[alone].mean()


@pytest.mark.parametrize("span", [(0, 40), (560, 600)])
def test_the_ends_are_filled_and_the_error_bar_widens_outward(span):
    truth = body(noise=0.2)
    missing = missing_of([(3, *span)])
    solution = run_method("kriging", take_of(truth, missing), Params())
    assert rms((solution.positions - truth)[missing]) < 1.0
    outward = solution.sd[slice(*span), 3]
    outward = outward if span[0] else outward[::-1]
    assert outward[-1] > outward[0]


def test_fills_join_the_trusted_samples_without_a_step():
    truth = body()
    missing = missing_of([(1, 100, 190), (6, 240, 300), (7, 250, 330)])
    positions = np.where(missing[..., None], run_method("kriging", take_of(truth, missing), Params()).positions, truth)
    steps = np.abs(np.diff(positions, n=2, axis=0)).max()
    assert steps < np.abs(np.diff(truth, n=2, axis=0)).max() + 0.5


def test_error_bars_cover_90_percent_of_the_errors():
    covered = []
    for seed in range(4):
        truth = body(noise=0.5, seed=seed)
        missing = occlude(take_of(truth), np.random.default_rng(seed), 0.08)
        solution = run_method("kriging", take_of(truth, missing), Params())
        covered.append(np.abs(solution.positions - truth)[missing] < 1.645 * solution.sd[missing][:, None])
    assert 0.8 < np.concatenate(covered).mean() < 0.98


def test_rigid_pairs_keep_their_lengths():
    truth = body(noise=0.02)
    length = np.linalg.norm(truth[:, 1] - truth[:, 0], axis=1).mean()
    missing = block_loss(600, 15, 60, 3, np.random.default_rng(1))
    solution = run_method("kriging", take_of(truth, missing), Params(bone_spread=0.05))
    filled = np.where(missing[..., None], solution.positions, truth)
    stretch = np.linalg.norm(filled[:, 1] - filled[:, 0], axis=1) - length
    assert rms(stretch[missing[:, [0, 1]].any(axis=1)]) < 0.05


def test_a_gap_whose_neighbours_go_is_filled_in_segments():
    missing = missing_of([(1, 100, 200), *((k, 150, 200) for k in (0, 2, 3, 4))])
    state = TakeState(take_of(body(noise=0.02), missing), Params())
    assert split_gap(state.known, state.distances.weights(1), 100, 200) == [(100, 150), (150, 200)]
    solution = run_method("kriging", take_of(body(noise=0.02), missing), Params())
    assert solution.filled[missing].all()


def test_two_people_do_not_disturb_each_other():
    one, other = body(seed=1), body(seed=2)[::-1] + np.array([4000.0, 0, 0])
    missing = missing_of([(1, 100, 220)])
    both = np.concatenate([one, other], axis=1)
    wide = np.concatenate([missing, np.zeros_like(missing)], axis=1)
    alone = run_method("kriging", take_of(one, missing), Params())
    together = run_method("kriging", take_of(both, wide), Params())
    assert rms((together.positions[:, :15] - one)[missing]) < rms((alone.positions - one)[missing]) + 0.5


def test_random_loss_is_filled_everywhere(rng):
    truth = body(300)
    missing = rng.random((300, 15)) < 0.4
    take = take_of(truth, missing)
    solution = run_method("kriging", take, Params(passes=1))
    assert np.array_equal(solution.filled, fillable(take.trusted))
    assert rms((solution.positions - truth)[solution.filled]) < 1.0
    assert solution.facts["passes"] == 1


def test_unwanted_gaps_are_left_and_the_wanted_ones_do_not_change():
    missing = missing_of([(1, 100, 140), (8, 300, 360)])
    wanted = missing_of([(8, 310, 320)])
    take = take_of(body(noise=0.3), missing)
    whole, part = (
        run_method("kriging", take, Params(bone_spread=0.0)),
        run_method("kriging", take, Params(bone_spread=0.0), wanted=wanted),
    )
    assert np.array_equal(part.filled, missing_of([(8, 300, 360)]))
    assert np.allclose(part.positions[300:360, 8], whole.positions[300:360, 8], rtol=0, atol=1e-6)
    assert np.allclose(part.sd[300:360, 8], whole.sd[300:360, 8], rtol=1e-9)


def test_unwanted_gaps_are_filled_where_the_wanted_ones_learn_from_them(rng):
    truth = body(480)
    missing = block_loss(480, 15, 40, 6, rng)
    wanted = missing & (np.arange(15) == 3)
    whole, part = (
        run_method("kriging", take_of(truth, missing), Params()),
        run_method("kriging", take_of(truth, missing), Params(), wanted=wanted),
    )
    assert part.filled.sum() > wanted.sum()
    assert rms((part.positions - truth)[wanted]) < 1.5 * rms((whole.positions - truth)[wanted]) + 0.1


def test_no_fill_is_farther_from_its_segment_than_twice_the_largest_known_distance():
    truth = body(240)
    missing = block_loss(240, 15, 40, 8, np.random.default_rng(3))
    solution = run_method("kriging", take_of(truth, missing), Params())
    assert np.abs(solution.positions - truth)[solution.filled].max() < 2000.0


def test_markers_that_are_lost_together_at_the_end_do_not_mislead_each_other():
    truth = body()
    n_frames = len(truth)
    missing = missing_of([(marker, n_frames - 3, n_frames) for marker in range(5)])
    solution = run_method("kriging", take_of(truth, missing), Params(bone_spread=0.0))
    assert solution.filled[missing].all()
    assert rms((solution.positions - truth)[missing]) < 0.1


def test_a_marker_that_is_seldom_trusted_is_filled():
    truth = body(noise=0.02)
    missing = missing_of([(0, start, start + 49) for start in range(1, 551, 50)] + [(0, 551, 600)])
    solution = run_method("kriging", take_of(truth, missing), Params())
    assert solution.filled[missing].all()
    assert rms((solution.positions - truth)[missing]) < 1.0


def test_a_knee_between_hip_and_ankle_is_predicted_on_its_circle(rng):
    t = np.arange(900) / RATE
    swing, bend, lean = 0.6 * np.sin(5 * t), 1.0 + 0.8 * np.sin(5 * t + 1) + 0.2 * np.sin(13 * t), 0.3 * np.sin(3 * t)

    def limb(length, angle):
        return length * np.stack([np.sin(angle), np.cos(angle) * np.sin(lean), -np.cos(angle) * np.cos(lean)], axis=1)

    hip = np.stack([800 * t, 20 * np.sin(5 * t), 900 + 30 * np.sin(10 * t)], axis=1)
    knee = hip + limb(400, swing)
    ankle = knee + limb(430, swing - bend)
    others = [hip + offset for offset in rng.normal(size=(3, 3)) * 100]
    truth = np.stack([hip, knee, ankle, ankle + limb(150, swing - bend + 1.5), *others], axis=1)
    missing = np.zeros((900, 7), dtype=bool)
    missing[400:520, 1] = True
    solution = run_method("kriging", take_of(truth, missing), Params())
    assert rms((solution.positions - truth)[missing]) < 2.0


def test_a_point_computed_from_a_marker_is_no_neighbour_of_it():
    truth = body(noise=0.3)
    missing = missing_of([(1, 100, 220)])
    # A point that follows marker 1 exactly, and that has a fault of its own where the marker is distrusted.
    follower = truth[:, 1] + [40.0, 0, 60]
    follower[100:220] += 200.0
    both = np.concatenate([truth, follower[:, None]], axis=1)
    wide = np.concatenate([missing, np.zeros((600, 1), bool)], axis=1)
    alone = run_method("kriging", take_of(truth, missing), Params())
    together = run_method("kriging", take_of(both, wide), Params())
    assert rms((together.positions[:, :15] - alone.positions)[missing]) < 0.1


def test_more_gaps_are_filled_from_a_solution_without_filling_its_gaps_again(rng):
    truth, first = body(480, noise=0.2), block_loss(480, 15, 40, 4, rng)
    more = missing_of([(3, 130, 150), (8, 300, 330)], 480) & ~first
    begun = run_method("kriging", take_of(truth, first), Params())
    solution = run_method("kriging", take_of(truth, first | more), Params(), wanted=more, begun=begun)
    anew = run_method("kriging", take_of(truth, first | more), Params(), wanted=more)
    assert solution.filled[first | more].all()
    assert np.array_equal(solution.sd[first], begun.sd[first])
    assert rms((solution.positions - truth)[more]) < 1.2 * rms((anew.positions - truth)[more]) + 0.05


def test_a_solution_to_begin_with_has_no_say_where_its_samples_are_trusted(rng):
    truth, first = body(480, noise=0.2), missing_of([(1, 100, 140), (8, 300, 330)], 480)
    begun = run_method("kriging", take_of(truth, first), Params())
    second = missing_of([(4, 200, 230)], 480)
    once = run_method("kriging", take_of(truth, second), Params())
    again = run_method("kriging", take_of(truth, second), Params(), begun=begun)
    assert np.array_equal(once.positions, again.positions)
    assert np.array_equal(once.sd, again.sd)
