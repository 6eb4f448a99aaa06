"""A Kalman smoother in the few dimensions that a take moves in.

    z_t = z_{t−1} + N(0, Q)    x_t = μ + V z_t + N(0, r I)    x_missing = μ + V E[z_t | all that is trusted]

V holds the principal components of the complete frames, the fewest whose singular values make up all but the share
``tolerance``; Q is the covariance of the components' differences from frame to frame.

M. Burke, J. Lasenby, 2016, doi:10.1016/j.jbiomech.2016.04.016.

Where this departs from the authors' program, and why:

- The smoother's gain is P_{t|t} P_{t+1|t}⁻¹; theirs has P_{t|t−1}⁻¹. Q is made of variances, where theirs is made of
  standard deviations, and of frames that follow each other. The last component of the share is kept.
- Q is full by default: components that move together keep doing so in a gap. ``process="diagonal"`` is VᵀDV with the
  variances D of the coordinates' differences.
- The noise is some millimetres, what the components miss of a marker, where theirs has a variance of 0.001 mm² (or
  0.05): so sure of what is seen, the smoother makes the rest swing with whatever the components do not hold.
- The start is as uncertain as a take is large, a thousand times over, instead of random with a variance of 10¹² mm².
- Where fewer than ``complete_share`` of the frames are complete, or none in half of the take, the components are of
  all frames, the gaps going straight about a point that travels with the body, and once more as then filled.

``sd`` is what the smoother expects of itself, and what the components leave out in the frames they come from. Cost:
O(F D² + F M D), D the number of components, and O(D³) for each frame in which covariances have not settled yet.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import Bools, Floats, runs
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.geometry.moving_origin import moving_origin
from mocapclean.numerics import interpolation
from mocapclean.numerics.low_rank.centred_matrix import centred_matrix
from mocapclean.numerics.state_space.linear_dynamics import LinearSystem
from mocapclean.numerics.state_space.smoother import Dynamics, Masks, kalman_filter, measure, rts_smoother
from mocapclean.parameters import STRICT
from mocapclean.solvers.fillable import fillable
from mocapclean.take import Solution, Take

REFERENCE = (
    "M. Burke, J. Lasenby, 2016, Estimating missing marker positions using low dimensional Kalman smoothing, "
    "doi:10.1016/j.jbiomech.2016.04.016"
)

_FLAT = 1e-6  # a direction this much flatter than the first is rounding
_WIDE = 1e3
_LEAST = 1e-6  # of the noise, for a component that never moves
_FEWEST = 2


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """How many components there are, and how they move."""

    tolerance: Annotated[
        float, Field(gt=0, lt=1, description="τ, 1, share of the sum of singular values that is left out")
    ] = 0.0025
    noise: Annotated[float, Field(gt=0, description="√r, mm, standard deviation of what the components miss")] = 2.0
    process: Annotated[
        Literal["full", "diagonal"], Field(description="Q, 1, covariance of the components, or VᵀDV of coordinates")
    ] = "full"
    complete_share: Annotated[
        float, Field(ge=0, le=1, description="c, 1, least share of complete frames to learn from these alone")
    ] = 0.1


def solve(take: Take, params: Params, library: Dictionary | None = None) -> Solution:
    """Fill every marker and frame that has some evidence, edges included; sd is in millimetres."""
    wanted = fillable(take.trusted)
    data = centred_matrix(take.positions, take.trusted)
    if not wanted.any():
        return Solution(positions=data.positions(data.values), filled=wanted, reason="nothing to fill")
    masks = Masks(take.trusted[:, data.used])
    complete: Bools = np.all(masks.seen, axis=1)
    enough = _is_enough(complete, params.complete_share)
    guess = data.values if enough else _straight(data.values, masks.seen)
    for _ in range(1 if enough else 2):
        model = Model(guess, complete if enough else np.ones_like(complete), data.spread, params)
        guess, variance = model.smooth(data.values, masks)
        guess = np.where(data.known, data.values, guess)
    sd = np.zeros(wanted.shape)
    sd[:, data.used] = np.sqrt(variance)
    return Solution(
        positions=data.positions(guess),
        filled=wanted,
        sd=sd,
        facts={"components": len(model.system.dynamics.start), "complete_frames": int(complete.sum())},
    )


def _is_enough(complete: Bools, share: float) -> bool:
    """Whether the complete frames are many, and not all from one part of the take."""
    longest = np.diff(runs(~complete), axis=1).max(initial=0)
    return bool(complete.sum() >= max(_FEWEST, share * len(complete)) and longest <= len(complete) / 2)


def _straight(values: Floats, seen: Bools) -> Floats:
    """Values (T, n) with their gaps going straight about a point that travels with what is seen."""
    points = values.reshape(*seen.shape, 3)
    origin = moving_origin(points, seen)[:, None]
    return (interpolation.linear(points - origin, seen) + origin).reshape(values.shape)


class Model:
    """The components of some frames (T,) of values (T, n), and how they move.

    spread: the size of the take, mm. missed: (n / 3,) mean square of a coordinate that the components leave out.
    """

    def __init__(self, values: Floats, frames: Bools, spread: float, params: Params) -> None:
        sample = values[frames]
        self.mean = sample.mean(axis=0)
        offsets = sample - self.mean
        squares, basis = np.linalg.eigh(offsets.T @ offsets)
        sizes = np.sqrt(np.maximum(squares[::-1], 0.0))
        enough = np.searchsorted(np.cumsum(sizes), (1.0 - params.tolerance) * sizes.sum(), side="right") + 1
        n_kept = max(1, min(int(enough), int((sizes > _FLAT * sizes[0]).sum())))
        loadings = np.ascontiguousarray(basis[:, ::-1][:, :n_kept])
        steps = np.diff(values, axis=0)[frames[1:] & frames[:-1]]
        identity = np.eye(n_kept)
        self.system = LinearSystem(
            dynamics=Dynamics(
                transition=identity,
                process=_process(steps, loadings, params) + _LEAST * params.noise**2 * identity,
                start=np.zeros(n_kept),
                start_covariance=(_WIDE * spread) ** 2 * identity,
            ),
            loadings=loadings,
            noise_variance=params.noise**2,
        )
        missed = np.square(offsets - offsets @ loadings @ loadings.T).mean(axis=0)
        self.missed = missed.reshape(-1, 3).mean(axis=1)

    def smooth(self, values: Floats, masks: Masks) -> tuple[Floats, Floats]:
        """The expected values (T, n), and the variance (T, n / 3) of a coordinate."""
        seen = np.repeat(masks.seen, 3, axis=1)
        centred = np.where(seen, values - self.mean, 0.0)
        measurements = measure(self.system.loadings, self.system.noise_variance, centred, masks)
        dynamics = self.system.dynamics
        smoothed = rts_smoother(dynamics, kalman_filter(dynamics, measurements))
        variance = self.system.value_variance(smoothed, len(self.missed)) + self.missed
        return self.mean + self.system.expected_values(smoothed.means), variance


def _process(steps: Floats, loadings: Floats, params: Params) -> Floats:
    """Q (D, D) of steps (N, n) from frame to frame."""
    if not len(steps):
        return np.zeros((loadings.shape[1], loadings.shape[1]))
    if params.process == "diagonal":
        return np.asarray((loadings.T * np.square(steps).mean(axis=0)) @ loadings)
    moves = steps @ loadings
    return np.asarray(moves.T @ moves / len(moves))
