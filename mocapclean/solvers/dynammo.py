"""DynaMMo: a linear dynamical system learned by expectation maximisation from what is trusted.

    z_1 ~ N(m, P_1)    z_t = A z_{t−1} + N(0, Q)    x_t = C z_t + N(0, r I)    x_missing = C E[z_t | trusted samples]

x_t (3M) is a frame, z_t (H) its hidden state. L. Li, J. McCann, N. S. Pollard, C. Faloutsos, 2009,
doi:10.1145/1557019.1557078.

Where this departs from the print, and why:

- ``em="exact"`` is expectation maximisation: the E-step sees only the trusted samples, each row of C is learned from
  the frames in which it is trusted, and the likelihood never falls. In the authors' programs the missing samples,
  as last estimated, count as data, so that r comes out too small and an estimate hardly moves once it is made.
  ``em="imputed"`` does that; what rises then is the likelihood of data and estimates together. ``em="plus"`` also
  fills them in anew on the way through the filter, by what it predicts; nothing is promised of that.
- No random start. The first system has the principal components of the linearly interpolated take, and as these
  hold the interpolation for motion, the first one is small: the number of states grows through ``state_schedule``,
  and each stage takes the components of the take as the one before filled it. An empty schedule starts at H.
- The authors' programs turn every frame so that named markers of the back give origin and direction. Here
  ``frame="body"`` lays each frame on the mean shape by all its trusted markers; ``frame="take"`` only takes the mean
  off. Lengths are in units of the root mean square of what remains, which stands for the authors' metres.
- The likelihood is judged per trusted coordinate, for its relative change depends on the unit of length.

Cost per iteration: O(F H² + F M H²), and O(H³) for each frame in which covariances have not settled yet.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import Bools, Floats
from mocapclean.dictionaries.dictionary import Dictionary
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
from mocapclean.parameters import STRICT
from mocapclean.solvers.fillable import fillable
from mocapclean.take import Solution, Take

REFERENCE = (
    "L. Li, J. McCann, N. S. Pollard, C. Faloutsos, 2009, DynaMMo: mining and summarization of coevolving sequences "
    "with missing values, doi:10.1145/1557019.1557078"
)
LEAST = 1e-10  # of any variance: a hundred thousandth of the take's size
FURTHEST = 1e3


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """The size of the hidden state, how it is learned, and when to stop."""

    states: Annotated[int, Field(ge=1, le=64, description="H, 1, dimension of the hidden state")] = 16
    em: Annotated[
        Literal["exact", "imputed", "plus"],
        Field(description="E, 1, missing samples integrated out, or counted as data as in DynaMMo or in DynaMMo+"),
    ] = "exact"
    process: Annotated[
        Literal["isotropic", "full"], Field(description="Q, 1, covariance of the process noise: multiple of I, or any")
    ] = "isotropic"
    frame: Annotated[
        Literal["body", "take"], Field(description="x, 1, coordinates turned with the body, or about one mean")
    ] = "body"
    state_schedule: Annotated[
        tuple[Annotated[int, Field(ge=1, strict=True)], ...],
        Field(strict=False, description="H_s, 1, numbers of states passed through on the way to H; empty: start at H"),
    ] = (1, 2, 3, 4, 6, 8, 10, 12, 14)
    stage_iterations: Annotated[int, Field(ge=1, description="k, 1, iterations at each number of the schedule")] = 5
    tolerance: Annotated[
        float, Field(ge=0, description="ε, 1, rise of the log-likelihood per trusted coordinate to stop at")
    ] = 1e-3
    max_iterations: Annotated[int, Field(ge=1, description="K, 1, most iterations in all")] = 100


def solve(take: Take, params: Params, library: Dictionary | None = None) -> Solution:
    """Fill every marker and frame that has some evidence, edges included.

    ``positions`` holds C E[z_t] everywhere, sd what the system expects of itself. The trace is the log-likelihood per
    trusted coordinate (of trusted and estimated ones with ``em="imputed"``), in normalised units; it rises within each
    stage of the schedule. Raises SolverError where ``em="plus"`` diverges.
    """
    wanted = fillable(take.trusted)
    if not wanted.any():
        known = np.where(take.trusted[..., None], take.positions, 0.0)
        return Solution(positions=known, filled=wanted, reason="nothing to fill")
    columns = Columns(take, params.frame)
    learner = Learner(columns, params)
    learner.learn()
    return Solution(
        positions=columns.positions(learner.system.expected_values(learner.smoothed.means)),
        filled=wanted,
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
    """A take as the columns of a system, from the markers that are trusted somewhere (used, (M,) bool).

    start: (F, n) linearly interpolated; seen: (F, n / 3); spread: millimetres per unit.
    """

    def __init__(self, take: Take, frame: str) -> None:
        self.used: Bools = np.asarray(take.trusted.any(axis=0))
        positions, self.seen = take.positions[:, self.used], take.trusted[:, self.used]
        known = np.where(self.seen[..., None], positions, 0.0)
        middle = known[self.seen].mean(axis=0)
        still = BodyFrames(np.tile(np.eye(3), (len(known), 1, 1)), np.tile(middle, (len(known), 1)))
        self.frames = mean_shape_frames(positions, self.seen) if frame == "body" else still
        local = interpolation.linear(self.frames.to_local(known), self.seen)
        self.spread = float(np.sqrt(np.square(local[self.seen]).mean())) or 1.0
        self.start = (local / self.spread).reshape(len(local), -1)

    def positions(self, columns: Floats) -> Floats:
        """Columns (F, n) as positions (F, M, 3), 0 for markers that are trusted nowhere."""
        positions = np.zeros((len(columns), len(self.used), 3))
        positions[:, self.used] = self.frames.to_world(columns.reshape(len(columns), -1, 3) * self.spread)
        return positions


class Learner:
    """Expectation maximisation, and where it has come to.

    guess: (F, n) the trusted values and, for the others, what the system makes of them. ``counted`` are the samples
    (F, n / 3) whose guess serves as data.
    """

    system: LinearSystem
    smoothed: Smoothed

    def __init__(self, columns: Columns, params: Params) -> None:
        self.columns, self.params, self.trusted = columns, params, Masks(columns.seen)
        self.counted = self.trusted if params.em == "exact" else Masks(np.ones_like(columns.seen))
        self.guess, self.iterations, self.limit, self.converged = columns.start, 0, params.max_iterations, False
        self.trace: list[float] = []

    def learn(self) -> None:
        """Pass through the schedule, then iterate until the likelihood stands still or the limit is reached."""
        params = self.params
        for n_states in (n for n in params.state_schedule if n < params.states):
            self.restart(n_states)
            self.iterate(params.stage_iterations)
        self.restart(params.states)
        self.iterate(self.limit, params.tolerance)

    def restart(self, n_states: int) -> None:
        """Take the principal components of the guess as the states."""
        if self.iterations < self.limit:
            self.system = system_of_principal_components(self.guess, n_states, LEAST)

    def iterate(self, n_iterations: int, tolerance: float = 0.0) -> None:
        """At most so many iterations; fewer when the likelihood rises by less than the tolerance."""
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
        """One E-step and one M-step; the log-likelihood per counted coordinate that the former found."""
        plus, full = self.params.em == "plus", self.params.process == "full"
        masks = self.trusted if plus else self.counted
        self.smoothed, likelihood = expectation_step(self.system, self._data(masks), masks, predict=plus)
        if plus:
            self.guess = self.impute()
            if not np.abs(self.guess).max() <= FURTHEST:
                raise SolverError("dynammo with em plus has diverged on this take; use em exact.")
        data = self._data(self.counted)
        self.system = maximisation_step(self.system, self.smoothed, data, self.counted, full=full, least=LEAST)
        self.guess = self.impute()
        return likelihood / (3 * np.count_nonzero(masks.seen))

    def _data(self, masks: Masks) -> Floats:
        return np.where(np.repeat(masks.seen, 3, axis=1), self.guess, 0.0)

    def impute(self) -> Floats:
        """The trusted values, and the expected ones elsewhere."""
        known = np.repeat(self.columns.seen, 3, axis=1)
        return np.where(known, self.columns.start, self.system.expected_values(self.smoothed.means))

    def deviation(self) -> Floats:
        """The expected error (F, M) per coordinate, millimetres; 0 for markers that are trusted nowhere."""
        columns = self.columns
        deviation = np.zeros((len(columns.seen), len(columns.used)))
        variance = self.system.value_variance(self.smoothed, columns.seen.shape[1])
        deviation[:, columns.used] = columns.spread * np.sqrt(variance)
        return deviation

    @property
    def reason(self) -> str:
        """Why it ended."""
        if self.converged:
            return f"the log-likelihood per trusted coordinate rises by less than {self.params.tolerance:g}"
        return f"max_iterations {self.params.max_iterations} reached"
