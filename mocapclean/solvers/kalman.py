"""A Kalman smoother on the principal components of a take.

    z_t = z_{t−1} + N(0, Q)    x_t = μ + V z_t + N(0, r I)    x_missing = μ + V E[z_t | trusted samples]

V are the principal components of the complete frames, the fewest whose singular values sum to all but the share
``tolerance``; Q is the covariance of the components' differences from frame to frame.

M. Burke, J. Lasenby, 2016, doi:10.1016/j.jbiomech.2016.04.016.

Where this departs from the authors' program, and why:

- The smoother's gain is P_{t|t} P_{t+1|t}⁻¹; theirs has P_{t|t−1}⁻¹. Q is made of variances, where theirs is made of
  standard deviations, and of frames that follow each other. The last component of the share is kept.
- Q is full by default: correlated components stay correlated in a gap. ``process="diagonal"`` is VᵀDV with the
  variances D of the coordinates' differences.
- The noise is the millimetres of a marker that the components leave out; theirs has a variance of 0.001 mm² (or 0.05).
  With so little noise the smoother moves the missing markers with all that the components leave out.
- The standard deviation of the first state is a thousand times the take's spread; theirs is random with a variance of
  10¹² mm².
- Where fewer than ``complete_share`` of the frames are complete, or none in half of the take, the components are those
  of all frames, first with gaps interpolated about a point that travels with the body, then once more as filled.

``sd`` has the posterior covariance of the smoother, and the residual of the components in the frames that they come
from; it is 0 where nothing is missing. The moments are those of a Kalman filter and smoother, computed by
``numerics.state_space.random_walk`` without a pass over the frames. Cost: O(F M D) for D components, O(D³) for each run
of frames in which the same markers are seen, and O(D²) for each missing sample.
"""

from typing import Annotated, Literal

import numpy as np

from mocapclean.arrays import Bools, Floats, runs
from mocapclean.geometry.moving_origin import moving_origin
from mocapclean.numerics import interpolation
from mocapclean.numerics.low_rank.centred_matrix import centred_matrix
from mocapclean.numerics.state_space.random_walk import expect_unseen, random_walk
from mocapclean.numerics.state_space.smoother import Masks
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers.method import Traits
from mocapclean.take import Solution, Take

REFERENCE = (
    "M. Burke, J. Lasenby, 2016, Estimating missing marker positions using low dimensional Kalman smoothing, "
    "doi:10.1016/j.jbiomech.2016.04.016"
)

TRAITS = Traits(error_bars=True)

# No sweep of these was kept.
_ROUNDING = 1e-6  # a component whose singular value is below this share of the first is rounding
_START_SPREADS = 1e3  # SD of the first state, in spreads of the take
_LEAST_PROCESS = 1e-6  # share of the noise variance that is added to Q, for a component that never moves
_FEWEST_COMPLETE = 2  # complete frames that principal components need


@parameters
class Params:
    """The number of components, and their random walk."""

    tolerance: Annotated[
        float, Field(gt=0, lt=1), About(symbol="τ", text="share of the sum of singular values that is left out")
    ] = 0.0025
    noise: Annotated[
        float, Field(gt=0), About(symbol="√r", unit="mm", text="standard deviation of the residual of the components")
    ] = 2.0
    process: Annotated[
        Literal["full", "diagonal"], About(symbol="Q", text="covariance of the components, or VᵀDV of coordinates")
    ] = "full"
    complete_share: Annotated[
        float, Field(ge=0, le=1), About(symbol="c", text="least share of complete frames to learn from these alone")
    ] = 0.1


def solve(take: Take, params: Params, fillable: Bools) -> Solution:
    """Return the take with all fillable samples (F, M) filled; sd is in millimetres."""
    data = centred_matrix(take.positions, take.trusted)
    masks = Masks(take.trusted[:, data.used])
    complete: Bools = np.all(masks.seen, axis=1)
    enough = _is_enough(complete, params.complete_share)
    # Without enough complete frames the first model learns from interpolated gaps, the second from filled ones.
    guess = data.values if enough else _interpolated(data.values, masks.seen)
    for _ in range(1 if enough else 2):
        model = Model(guess, complete if enough else np.ones_like(complete), data.spread, params)
        guess, variance = model.expect(data.values, masks)
        guess = np.where(data.known, data.values, guess)
    sd = np.zeros(fillable.shape)
    sd[:, data.used] = np.sqrt(variance)
    return Solution(
        positions=data.positions(guess),
        filled=fillable,
        sd=sd,
        facts={"components": len(model.walk.start), "complete_frames": int(complete.sum())},
    )


def _is_enough(complete: Bools, share: float) -> bool:
    """Whether complete frames (F,) are at least a share of all, and no half of the take is without one."""
    longest = np.diff(runs(~complete), axis=1).max(initial=0)
    return bool(complete.sum() >= max(_FEWEST_COMPLETE, share * len(complete)) and longest <= len(complete) / 2)


def _interpolated(values: Floats, seen: Bools) -> Floats:
    """Return values (F, n) with straight gaps about a point that travels with the seen (F, n / 3) markers."""
    points = values.reshape(*seen.shape, 3)
    origin = moving_origin(points, seen)[:, None]
    return (interpolation.linear(points - origin, seen) + origin).reshape(values.shape)


class Model:
    """The principal components of some frames (F,) of values (F, n), and their random walk.

    spread: the size of the take, mm. missed: (n / 3,) mean square of a coordinate that the components leave out, mm².
    """

    def __init__(self, values: Floats, frames: Bools, spread: float, params: Params) -> None:
        # μ and V: the fewest components whose singular values sum to 1 − τ of all
        sample = values[frames]
        self.mean = sample.mean(axis=0)
        offsets = sample - self.mean
        squares, basis = np.linalg.eigh(offsets.T @ offsets)
        sizes = np.sqrt(np.maximum(squares[::-1], 0.0))
        enough = np.searchsorted(np.cumsum(sizes), (1.0 - params.tolerance) * sizes.sum(), side="right") + 1
        n_kept = max(1, min(int(enough), int((sizes > _ROUNDING * sizes[0]).sum())))
        loadings = np.ascontiguousarray(basis[:, ::-1][:, :n_kept])
        # Q: from the differences between frames that follow each other
        steps = np.diff(values, axis=0)[frames[1:] & frames[:-1]]
        process = _process(steps, loadings, params) + _LEAST_PROCESS * params.noise**2 * np.eye(n_kept)
        self.walk = random_walk(loadings, process, (_START_SPREADS * spread) ** 2, params.noise**2)
        missed = np.square(offsets - offsets @ loadings @ loadings.T).mean(axis=0)
        self.missed = missed.reshape(-1, 3).mean(axis=1)

    def expect(self, values: Floats, masks: Masks) -> tuple[Floats, Floats]:
        """Return the expected values (F, n) where unseen, and the variance (F, n / 3) of a coordinate there; else 0."""
        seen = np.repeat(masks.seen, 3, axis=1)
        means, variance = expect_unseen(self.walk, np.where(seen, values - self.mean, 0.0), masks)
        return np.where(seen, 0.0, means + self.mean), np.where(masks.seen, 0.0, variance + self.missed)


def _process(steps: Floats, loadings: Floats, params: Params) -> Floats:
    """Return Q (D, D) from the differences (N, n) between adjacent frames."""
    if not len(steps):
        return np.zeros((loadings.shape[1], loadings.shape[1]))
    if params.process == "diagonal":
        # VᵀDV, D the variances of the coordinates' differences
        return np.asarray((loadings.T * np.square(steps).mean(axis=0)) @ loadings)
    moves = steps @ loadings
    return np.asarray(moves.T @ moves / len(moves))
