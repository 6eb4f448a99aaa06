"""Displacements of neighbours as features: the error of a marker whose place depends on the direction of motion."""

import numpy as np

from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method
from mocapclean.take import Take

RATE = 120.0


def _lagging_take(seed: int) -> Take:
    """A body whose last marker trails 0.1 s behind the others, on a path of a random mixture of sines."""
    rng = np.random.default_rng(seed)
    t = np.arange(1200)[:, None] / RATE
    frequencies, phases = rng.uniform(0.4, 1.1, 5), rng.uniform(0, 6.28, (3, 5))

    def swing(at):
        return np.stack([60.0 * np.sin(2 * np.pi * frequencies * at + phase).sum(axis=1) for phase in phases], axis=1)

    body = rng.uniform(-150, 150, (9, 3))
    still = rng.uniform(-150, 150, (4, 3)) + 900.0
    moving = swing(t)[:, None] + body
    late = swing(t - 0.1)[:, None] + body[:1] + 40.0
    at_rest = np.broadcast_to(still, (len(t), 4, 3))
    positions = np.concatenate([moving, at_rest, late], axis=1) + rng.normal(0.0, 0.1, (len(t), 14, 3))
    trusted = np.ones((len(t), 14), dtype=bool)
    trusted[500:620, -1] = False
    return Take(positions=positions, trusted=trusted, markers=tuple(f"M{k}" for k in range(14)), rate=RATE)


def test_a_marker_that_trails_the_others_is_filled_better_with_their_displacements():
    errors = {}
    for name, motion in (("with", 0.25), ("without", 1e9)):
        squares = []
        for seed in range(3):
            take = _lagging_take(seed)
            solution = run_method("kriging", take, SOLVERS["kriging"].Params(motion=motion))
            squares.append(np.square(solution.positions - take.positions)[solution.filled].mean())
        errors[name] = np.sqrt(np.mean(squares))
    assert errors["with"] < 0.5 * errors["without"]
