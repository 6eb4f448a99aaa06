"""Takes with many gaps and few common frames: whatever has no answer is left, and nothing is learnt from it."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mocapclean.solvers.kriging import Params
from mocapclean.solvers.running import run_method
from mocapclean.take import Take


def swarm(seed: int, n_frames: int, n_markers: int, seen: float, longest: int) -> Take:
    """Markers on paths of their own about a common one, each seen in short runs for a share of the time."""
    rng = np.random.default_rng(seed)
    t = np.arange(n_frames)[:, None, None] / 120.0
    phases = rng.uniform(0, 6.28, (1, n_markers, 3))
    positions = 300 * np.sin(2 * t) + 100 * rng.normal(size=(1, n_markers, 3)) + 40 * np.sin(5 * t + phases)
    trusted = np.zeros((n_frames, n_markers), dtype=bool)
    for marker in range(n_markers):
        while trusted[:, marker].mean() < seen * rng.uniform(0.1, 1.0):
            start = rng.integers(n_frames)
            trusted[start : start + rng.integers(1, longest), marker] = True
    names = tuple(f"m{k}" for k in range(n_markers))
    return Take(positions=np.where(trusted[..., None], positions, 0.0), trusted=trusted, markers=names, rate=120.0)


@settings(max_examples=10, deadline=None)
@given(
    st.integers(0, 10_000), st.integers(60, 200), st.integers(2, 9), st.floats(0.05, 0.7), st.sampled_from([4, 15, 60])
)
def test_any_pattern_of_gaps_gets_finite_answers_or_none(seed, n_frames, n_markers, seen, longest):
    take = swarm(seed, n_frames, n_markers, seen, longest)
    solution = run_method("kriging", take, Params(windows=4, learnt=60))
    assert not (solution.filled & take.trusted).any()
    assert np.isfinite(solution.positions).all()
    assert np.isfinite(solution.sd).all()
    assert (solution.sd[solution.filled] > 0.0).all()
    # Untrusted samples are never read, whatever the passes learn from.
    poisoned = replace(take, positions=np.where(take.trusted[..., None], take.positions, np.nan))
    again = run_method("kriging", poisoned, Params(windows=4, learnt=60))
    assert np.array_equal(again.positions[again.filled], solution.positions[solution.filled])


def test_a_marker_with_too_few_samples_stays_out_of_all_others():
    take = swarm(3, 200, 6, 0.7, 60)
    trusted = take.trusted.copy()
    trusted[:, 2] = False
    trusted[50:55, 2] = True
    few = replace(take, trusted=trusted)
    without = few.select(np.array([0, 1, 3, 4, 5]))
    solution, other = run_method("kriging", few, Params()), run_method("kriging", without, Params())
    assert not solution.filled[:50, 2].any()
    assert np.isfinite(solution.positions).all()
    both = solution.filled[:, [0, 1, 3, 4, 5]] & other.filled
    assert both.any()
    np.testing.assert_allclose(solution.positions[:, [0, 1, 3, 4, 5]][both], other.positions[both], atol=1e-6)
