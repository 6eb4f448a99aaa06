"""What Li et al. (2009) promise: a likelihood that only rises, and states that fill what they explain."""

from itertools import pairwise

import numpy as np
import pytest

from mocapclean.numerics.state_space.linear_dynamics import expectation_step, maximisation_step
from mocapclean.simulate import block_loss
from mocapclean.solvers.dynammo import LEAST_VARIANCE, Columns, Learner, Params
from mocapclean.solvers.running import run_method
from mocapclean.take import Take


def swinging(
    rng: np.random.Generator, n_frames: int = 300, noise: float = 1.0, n_out: int = 2, length: int = 30
) -> tuple[Take, np.ndarray]:
    """Ten markers driven by two damped oscillators with random pushes, ``n_out`` lost in every ``length`` frames."""
    states = np.zeros((n_frames, 4))
    states[0] = [1, 0, 0, 1]
    turns = [np.array([[np.cos(w), -np.sin(w)], [np.sin(w), np.cos(w)]]) for w in (0.1, 0.23)]
    for t in range(1, n_frames):
        for k, rotation in enumerate(turns):
            states[t, 2 * k : 2 * k + 2] = 0.995 * rotation @ states[t - 1, 2 * k : 2 * k + 2]
        states[t] += 0.05 * rng.normal(size=4)
    truth = (300 * states @ rng.normal(size=(4, 30))).reshape(n_frames, 10, 3)
    missing = block_loss(n_frames, 10, length, n_out, rng)
    seen = truth + noise * rng.normal(size=truth.shape)
    take = Take(
        positions=np.where(missing[..., None], 0.0, seen), trusted=~missing, markers=tuple("abcdefghij"), rate=60.0
    )
    return take, truth


def error(take: Take, truth: np.ndarray, **parameters: object) -> float:
    estimate = run_method("dynammo", take, Params(**parameters)).positions
    return float(np.sqrt(np.square(estimate - truth)[~take.trusted].mean()))


@pytest.mark.parametrize("process", ["isotropic", "full"])
@pytest.mark.parametrize("em", ["exact", "imputed"])
@pytest.mark.parametrize("frame", ["body", "take"])
def test_the_likelihood_never_falls(rng, em, process, frame):
    take, _ = swinging(rng)
    params = Params(em=em, process=process, frame=frame, states=6, state_schedule=(), max_iterations=40, tolerance=0.0)
    trace = run_method("dynammo", take, params).trace
    assert len(trace) == 40
    assert all(b >= a - 1e-10 for a, b in pairwise(trace))
    assert trace[-1] > trace[0] + 0.01


def test_an_iteration_goes_uphill_from_its_first_inch(rng):
    take, _ = swinging(rng, 80)
    learner = Learner(Columns(take, "take"), Params(states=3, state_schedule=(), max_iterations=5, tolerance=0.0))
    learner.learn()
    data, before = learner._data(learner.counted), learner.system
    smoothed, likelihood = expectation_step(before, data, learner.counted)
    after = maximisation_step(before, smoothed, data, learner.counted, full=False, least=LEAST_VARIANCE)
    for share in (1e-3, 0.1, 1.0):
        loadings = before.loadings + share * (after.loadings - before.loadings)
        moved = type(before)(dynamics=before.dynamics, loadings=loadings, noise_variance=before.noise_variance)
        assert expectation_step(moved, data, learner.counted)[1] > likelihood


@pytest.mark.parametrize("em", ["exact", "imputed"])
def test_a_system_of_the_right_size_is_filled_to_the_noise(rng, em):
    take, truth = swinging(rng)
    assert error(take, truth, em=em, frame="take", states=4, max_iterations=200) < 3.0


def test_the_expected_error_is_the_error(rng):
    take, truth = swinging(rng, noise=20.0)
    solution = run_method("dynammo", take, Params(frame="take", states=4))
    ratio = (solution.positions - truth)[~take.trusted] / solution.sd[~take.trusted][:, None]
    assert 0.4 < np.sqrt(np.mean(ratio**2)) < 1.2


def test_growing_the_state_escapes_the_interpolated_start():
    take, truth = swinging(np.random.default_rng(0), n_out=4, length=60)
    grown, at_once = (error(take, truth, frame="take", states=8, state_schedule=s) for s in ((1, 2, 3, 4, 6), ()))
    assert grown < 0.5 * at_once


def test_without_gaps_every_kind_of_em_is_the_same(rng):
    take, truth = swinging(rng, 60)
    whole = Take(positions=truth, trusted=np.ones_like(take.trusted), markers=take.markers, rate=60.0)
    systems = []
    for em in ("exact", "imputed", "plus"):
        learner = Learner(Columns(whole, "body"), Params(em=em, states=4, max_iterations=4))
        learner.learn()
        systems.append(learner.system.loadings)
    np.testing.assert_allclose(systems[1], systems[0], atol=1e-12)
    np.testing.assert_allclose(systems[2], systems[0], atol=1e-12)


def test_plus_fills_on_the_way_and_gets_near(rng):
    take, truth = swinging(rng)
    linear = error(take, truth, frame="take", states=1, max_iterations=1)
    assert error(take, truth, em="plus", frame="take", states=4) < 0.2 * linear


def test_states_are_no_more_than_the_take_has_directions(rng):
    take, _ = swinging(rng, 12, length=4)
    assert run_method("dynammo", take, Params(states=64, max_iterations=60)).facts["states"] <= 12


def test_body_coordinates_take_out_a_turning_walk(rng):
    take, truth = swinging(rng)
    angle = 0.02 * np.arange(len(truth))
    cos, sin, zero = np.cos(angle), np.sin(angle), 0 * angle
    turns = np.array([[cos, -sin, zero], [sin, cos, zero], [zero, zero, zero + 1]]).transpose(2, 0, 1)
    shape = 1000 * rng.normal(size=(10, 3))

    def walk(positions: np.ndarray) -> np.ndarray:
        return (shape + 0.1 * positions) @ turns.swapaxes(1, 2) + 15.0 * np.arange(len(positions))[:, None, None]

    walking = Take(
        positions=np.where(take.trusted[..., None], walk(take.positions), 0.0),
        trusted=take.trusted,
        markers=take.markers,
        rate=60.0,
    )
    body, still = (error(walking, walk(truth), frame=frame, states=6) for frame in ("body", "take"))
    assert body < 0.5 * still
