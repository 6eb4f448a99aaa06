"""DynaMMo: a linear dynamical system learned by expectation maximisation from the trusted samples.

    z_1 ~ N(m, P_1)    z_t = A z_{t−1} + N(0, Q)    x_t = C z_t + N(0, r I)    x_missing = C E[z_t | trusted samples]

x_t (3M) is a frame, z_t (H) its hidden state. L. Li, J. McCann, N. S. Pollard, C. Faloutsos, 2009,
doi:10.1145/1557019.1557078.

Where this departs from the print, and why:

- ``em="exact"`` is expectation maximisation: the E-step sees only the trusted samples, each row of C is learned from
  the frames in which it is trusted, and the likelihood never falls. In the authors' programs the last estimates of the
  missing samples count as data, so r comes out too small and an estimate hardly moves once it is made.
  ``em="imputed"`` does that; then the likelihood of data and estimates together rises. ``em="plus"`` also replaces the
  estimates by the predictions of the forward pass as it goes; the likelihood may then fall.
- No random start. The first system has the principal components of the linearly interpolated take. These contain
  the interpolated gaps as if they were motion, so the first system is small: the number of states grows through
  ``state_schedule``, and each stage takes the components of the take as the previous stage filled it. An empty
  schedule starts at H.
- The authors' programs turn every frame so that named markers of the back give origin and direction. Here
  ``frame="body"`` aligns each frame with the mean shape by all its trusted markers; ``frame="take"`` only subtracts the
  mean. Lengths are in units of the root mean square of the result, in place of the authors' metres.
- The likelihood is judged per trusted coordinate, for its relative change depends on the unit of length.

Cost per iteration: O(F H² + F M H²), and O(H³) for each frame in which covariances have not settled yet.
"""

from typing import Annotated, Literal

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.errors import SolverError
from mocapclean.geometry.alignment import mean_shape_frames
from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.numerics import interpolation
from mocapclean.numerics.state_space.linear_dynamics import (
    LinearSystem,
    expectation_step,
    maximisation_step,
    system_of_principal_components,
)
from mocapclean.numerics.state_space.smoother import Masks, Smoothed
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers.method import Traits, limit_reached
from mocapclean.take import Solution, Take

REFERENCE = (
    "L. Li, J. McCann, N. S. Pollard, C. Faloutsos, 2009, DynaMMo: mining and summarization of coevolving sequences "
    "with missing values, doi:10.1145/1557019.1557078"
)
TRAITS = Traits(error_bars=True)

LEAST_VARIANCE = 1e-10  # of any variance, in squared spreads of the take: an SD of 1e-5 spreads; no sweep was kept
DIVERGED = 1e3  # spreads of the take from the origin at which ``em="plus"`` counts as diverged; no sweep was kept


@parameters
class Params:
    """The size of the hidden state, the learning, and the stopping rule."""

    states: Annotated[int, Field(ge=1, le=64), About(symbol="H", text="dimension of the hidden state")] = 16
    em: Annotated[
        Literal["exact", "imputed", "plus"],
        About(symbol="E", text="missing samples integrated out, or counted as data as in DynaMMo or in DynaMMo+"),
    ] = "exact"
    process: Annotated[
        Literal["isotropic", "full"], About(symbol="Q", text="covariance of the process noise: multiple of I, or any")
    ] = "isotropic"
    frame: Annotated[
        Literal["body", "take"], About(symbol="x", text="coordinates turned with the body, or about one mean")
    ] = "body"
    state_schedule: Annotated[
        tuple[Annotated[int, Field(ge=1, strict=True)], ...],
        Field(strict=False),
        About(symbol="H_s", text="numbers of states passed through before H; empty: start at H"),
    ] = (1, 2, 3, 4, 6, 8, 10, 12, 14)
    stage_iterations: Annotated[
        int, Field(ge=1), About(symbol="k", text="iterations at each number of the schedule")
    ] = 5
    tolerance: Annotated[
        float, Field(ge=0), About(symbol="ε", text="rise of the log-likelihood per trusted coordinate to stop at")
    ] = 1e-3
    max_iterations: Annotated[int, Field(ge=1), About(symbol="K", text="most iterations in all")] = 100


def solve(take: Take, params: Params, fillable: Bools) -> Solution:
    """Return the take with all fillable samples (F, M) filled.

    ``positions`` holds C E[z_t] everywhere, sd the standard deviation that the system expects. The trace is the
    log-likelihood per trusted coordinate (of trusted and estimated ones with ``em="imputed"``), in normalised units; it
    rises within each stage of the schedule. Raises SolverError where ``em="plus"`` diverges.
    """
    columns = Columns(take, params.frame)
    learner = Learner(columns, params)
    learner.learn()
    return Solution(
        positions=columns.positions(learner.system.expected_values(learner.smoothed.means)),
        filled=fillable,
        sd=learner.deviation() if params.em == "exact" else None,
        converged=learner.converged,
        iterations=learner.iterations,
        reason=learner.reason,
        trace=tuple(learner.trace),
        facts={
            "states": len(learner.system.dynamics.start),
            "noise_mm": columns.spread * learner.system.noise_variance**0.5,
        },
    )


class Columns:
    """A take as the columns of a linear system, from the markers that are trusted in some frame (used, (M,) bool).

    start: (F, n) linearly interpolated, in spreads. seen: (F, n / 3) the trusted samples. spread: millimetres per unit.
    """

    def __init__(self, take: Take, frame: str) -> None:
        self.used: Bools = np.asarray(take.trusted.any(axis=0))
        positions, self.seen = take.positions[:, self.used], take.trusted[:, self.used]
        known = np.where(self.seen[..., None], positions, 0.0)
        mean = known[self.seen].mean(axis=0)
        unturned = BodyFrames(np.tile(np.eye(3), (len(known), 1, 1)), np.tile(mean, (len(known), 1)))
        self.frames = mean_shape_frames(positions, self.seen) if frame == "body" else unturned
        local = interpolation.linear(self.frames.to_local(known), self.seen)
        self.spread = float(np.sqrt(np.square(local[self.seen]).mean())) or 1.0
        self.start = (local / self.spread).reshape(len(local), -1)

    def positions(self, columns: Floats) -> Floats:
        """Return columns (F, n) as positions (F, M, 3) in millimetres, 0 for markers that are trusted in no frame."""
        positions = np.zeros((len(columns), len(self.used), 3))
        positions[:, self.used] = self.frames.to_world(columns.reshape(len(columns), -1, 3) * self.spread)
        return positions


class Learner:
    """Expectation maximisation, and its present state.

    guess: (F, n) the trusted values, and C E[z_t] elsewhere. counted: the samples (F, n / 3)
    whose guess serves as data.
    """

    system: LinearSystem
    smoothed: Smoothed

    def __init__(self, columns: Columns, params: Params) -> None:
        self.columns, self.params, self.trusted = columns, params, Masks(columns.seen)
        self.counted = self.trusted if params.em == "exact" else Masks(np.ones_like(columns.seen))
        self.guess, self.iterations, self.limit, self.converged = columns.start, 0, params.max_iterations, False
        self.trace: list[float] = []

    def learn(self) -> None:
        """Pass through the schedule, then iterate until the likelihood is stationary or the limit is reached."""
        params = self.params
        for n_states in (n for n in params.state_schedule if n < params.states):
            self.restart(n_states)
            self.iterate(params.stage_iterations)
        self.restart(params.states)
        self.iterate(self.limit, params.tolerance)

    def restart(self, n_states: int) -> None:
        """Take the principal components of the guess as the states."""
        if self.iterations < self.limit:
            self.system = system_of_principal_components(self.guess, n_states, LEAST_VARIANCE)

    def iterate(self, n_iterations: int, tolerance: float = 0.0) -> None:
        """Take at most so many steps; stop when the likelihood changes by less than the tolerance."""
        before = -np.inf
        for _ in range(min(n_iterations, self.limit - self.iterations)):
            likelihood = self.step()
            self.trace.append(likelihood)
            self.iterations += 1
            if abs(likelihood - before) < tolerance:
                self.converged = True
                break
            before = likelihood

    def step(self) -> float:
        """Take one E-step and one M-step; return the log-likelihood per counted coordinate from the E-step."""
        plus, full = self.params.em == "plus", self.params.process == "full"
        # E-step: the moments of z_t given the counted samples
        masks = self.trusted if plus else self.counted
        self.smoothed, likelihood = expectation_step(self.system, self._data(masks), masks, predict=plus)
        if plus:
            self.guess = self.impute()
            if not np.abs(self.guess).max() <= DIVERGED:
                raise SolverError("dynammo with em plus has diverged on this take; use em exact.")
        # M-step: m, P_1, A, Q, C and r that maximise the expected likelihood
        data = self._data(self.counted)
        self.system = maximisation_step(self.system, self.smoothed, data, self.counted, full=full, least=LEAST_VARIANCE)
        self.guess = self.impute()
        return likelihood / (3 * np.count_nonzero(masks.seen))

    def _data(self, masks: Masks) -> Floats:
        """Return the guess (F, n), 0 outside the masks."""
        return np.where(np.repeat(masks.seen, 3, axis=1), self.guess, 0.0)

    def impute(self) -> Floats:
        """Return the trusted values, and C E[z_t] elsewhere, (F, n)."""
        known = np.repeat(self.columns.seen, 3, axis=1)
        return np.where(known, self.columns.start, self.system.expected_values(self.smoothed.means))

    def deviation(self) -> Floats:
        """Return the expected error (F, M) per coordinate, mm; 0 for markers that are trusted in no frame."""
        columns = self.columns
        deviation = np.zeros((len(columns.seen), len(columns.used)))
        variance = self.system.value_variance(self.smoothed, columns.seen.shape[1])
        deviation[:, columns.used] = columns.spread * np.sqrt(variance)
        return deviation

    @property
    def reason(self) -> str:
        """Why the iteration ended."""
        if self.converged:
            return f"the log-likelihood per trusted coordinate rises by less than {self.params.tolerance:g}"
        return limit_reached(self.params, "max_iterations")
