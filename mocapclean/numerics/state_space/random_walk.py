"""The unseen values of a random walk behind many columns, without a pass over the frames one by one.

    z_1 ~ N(0, P_1)    z_t = z_{t−1} + N(0, Q)    x_t = C z_t + N(0, r I), of which some columns are seen

In the states y = Q^{-1/2} z the steps are N(0, I), and the columns W y with W = C Q^{1/2}. A frame enters by its
information matrix G_t = W_oᵀ W_o / r and vector h_t = W_oᵀ x_o / r over the columns o seen in it. The posterior of all
states has the energy ½ Σ |y_t − y_{t−1}|² + ½ Σ y_tᵀ G_t y_t − Σ h_tᵀ y_t: a chain of springs.

While the same columns are seen, G is constant. In its eigenvectors U it is diag(g), and so each coordinate of Uᵀ y is a
chain of its own. With e^{−θ} = λ and 2 cosh θ = 2 + g, the n steps from frame a to frame a + n leave between their ends

    ½ α y_a² − β y_a y_b + ½ (α + g) y_b²    α = 1 − sinh((n − 1) θ) / sinh(nθ)    β = sinh θ / sinh(nθ)

with linear terms from the data between them. A run of frames is thus one step between two nodes, however long it is,
and one eigenproblem. The nodes form a block-tridiagonal system of H × H blocks, solved by elimination forwards, and
backwards with the covariances of neighbouring nodes. The frames t of a run follow from its ends:

    y_t = u_t + a_t y_a + b_t y_b + N(0, s_t)    a_t = sinh((n − t) θ) / sinh(nθ)    b_t = sinh(tθ) / sinh(nθ)
    s_t = sinh(tθ) sinh((n − t) θ) / (sinh θ sinh(nθ))

u_t solves the chain with y_a = y_b = 0. All this is exact: the moments are those of a Kalman filter and smoother.

Cost: O(H³) for each run, O(F H) for the chains, O(F n H) for h, and O(H²) for each unseen sample.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.numerics.state_space.smoother import Masks

_SHORTEST = 6  # frames of one set of seen columns below which each is a step of its own; chosen for speed on 30 to 190
# states, where an eigenproblem costs as much as 4 to 8 frames
_LEAST_INFORMATION = 1e-24  # in place of an eigenvalue of G that is 0 or less by rounding
_MOST_STORED_ENTRIES = 2**23  # of the matrices that the backward pass needs: 64 MB; chosen for memory


@dataclass(frozen=True, kw_only=True)
class RandomWalk:
    """The columns W y + N(0, r I) of states y whose steps are N(0, I) and whose first has a given precision.

    loadings: (n, H), W. noise_variance: r. start: (H,), the diagonal of the precision of the first state about 0.
    """

    loadings: Floats
    noise_variance: float
    start: Floats


def random_walk(loadings: Floats, process: Floats, start_variance: float, noise_variance: float) -> RandomWalk:
    """Return the walk of states z about 0 whose steps have the positive definite covariance Q, and P_1 = p I.

    loadings: (n, H), C with x = C z. process: (H, H), Q.
    """
    # Q = B diag(q) Bᵀ and z = B diag(√q) y
    variances, axes = np.linalg.eigh(process)
    return RandomWalk(
        loadings=loadings @ (axes * np.sqrt(variances)),
        noise_variance=noise_variance,
        start=variances / start_variance,
    )


def expect_unseen(walk: RandomWalk, values: Floats, masks: Masks) -> tuple[Floats, Floats]:
    """Return the expected unseen values (T, n), 0 where seen, and the mean variance (T, g) of a column of a group.

    The noise of the columns is included in the variance. values: (T, n), 0 where not seen. masks: of g groups of n / g
    neighbouring columns each.
    """
    chain = _Chain(walk, values, masks)
    means, variances = np.zeros_like(values), np.zeros(masks.seen.shape)
    for run, moments in chain.from_the_end():
        run.put_unseen(moments, means, variances)
    variances[~masks.seen] += walk.noise_variance
    return means, variances


@dataclass(frozen=True)
class _Moments:
    """The moments of the states y_a and y_b at the two ends of a run.

    before, after: (H,), the means. covariance, cross, covariance_after: (H, H), of y_a, of y_a and y_b, and of y_b.
    """

    before: Floats
    after: Floats
    covariance: Floats
    cross: Floats
    covariance_after: Floats


class _Mask:
    """One set of seen columns: its unseen groups, and its information matrix in its eigenvectors.

    unseen: (m,) the groups. blocks: (m, n / g, H), their loadings.
    """

    def __init__(self, seen: Bools, groups: Floats, total: Floats, noise_variance: float) -> None:
        self.unseen = np.flatnonzero(~seen)
        self.blocks, self._total, self._noise_variance = groups[self.unseen], total, noise_variance

    def information(self) -> Floats:
        """Return G (H, H): that of all columns less that of the unseen ones."""
        rows = self.blocks.reshape(-1, len(self._total))
        information: Floats = self._total - rows.T @ rows / self._noise_variance
        return information

    @cached_property
    def spectrum(self) -> tuple[Floats, Floats]:
        """The eigenvalues g (H,) of G, and its eigenvectors U (H, H)."""
        values, vectors = np.linalg.eigh(self.information())
        return np.maximum(values, _LEAST_INFORMATION), vectors


class _Frame:
    """A run of one frame, b = a + 1: a spring of stiffness 1, and the information of frame b."""

    def __init__(self, mask: _Mask, last: int, vectors: Floats) -> None:
        self.mask, self.last, self._vector = mask, last, vectors[last]

    def left(self, precision: Floats, vector: Floats) -> tuple[Floats, Floats]:
        """Return the precision and the vector of y_a, given what the frames up to a have; both may be overwritten."""
        precision.ravel()[:: len(precision) + 1] += 1.0
        return precision, vector

    def gain(self, inverse: Floats) -> Floats:
        """Return the inverse (H, H) of the precision of y_a times the stiffness between y_a and y_b."""
        return inverse

    def right(self, gain: Floats, vector: Floats) -> tuple[Floats, Floats]:
        """Return the precision and the vector of y_b, from the gain and the vector of y_a."""
        precision = self.mask.information() - gain
        precision.ravel()[:: len(precision) + 1] += 1.0
        return precision, self._vector + vector @ gain

    def put_unseen(self, moments: _Moments, means: Floats, variances: Floats) -> None:
        """Put the unseen values of frame b into means (T, n), and their variances into variances (T, g)."""
        _put_frame(self.mask, self.last, moments.after, moments.covariance_after, means, variances)


class _Run:
    """A run of frames a + 1 to b with one set of seen columns."""

    def __init__(self, mask: _Mask, first: int, last: int, vectors: Floats) -> None:
        self.mask, self.last, self._first, self._n = mask, last, first, last - first + 1
        self._g, self._axes = mask.spectrum
        theta = 2.0 * np.arcsinh(0.5 * np.sqrt(self._g))
        self._theta, self._whole = theta, -np.expm1(-2.0 * self._n * theta)
        # α = (1 − λ)(1 + λ^{2n−1}) / (1 − λ^{2n}) and β = λ^{n−1}(1 − λ²) / (1 − λ^{2n})
        self._alpha = -np.expm1(-theta) * (1.0 + np.exp((1 - 2 * self._n) * theta)) / self._whole
        self._beta = np.exp((1 - self._n) * theta) * -np.expm1(-2.0 * theta) / self._whole
        self._between, self._end = self._particular(vectors), vectors[last] @ self._axes

    def _particular(self, vectors: Floats) -> Floats:
        """Return u (n − 1, H) in the eigenvectors: −u_{t−1} + (2 + g) u_t − u_{t+1} = h_t with u = 0 at both ends."""
        inputs = vectors[self._first : self.last] @ self._axes
        if not inputs.size:
            return inputs
        # The chains of all coordinates, one after another, are one tridiagonal system.
        n_states, n_inner = len(self._g), len(inputs)
        off_diagonal = np.full((n_states, n_inner), -1.0)
        off_diagonal[:, -1] = 0.0
        diagonal, off_diagonal, _ = scipy.linalg.lapack.dpttrf(
            np.repeat(2.0 + self._g, n_inner), off_diagonal.ravel()[:-1]
        )
        solution = scipy.linalg.lapack.dpttrs(diagonal, off_diagonal, inputs.T.reshape(-1, 1))[0]
        return np.ascontiguousarray(solution.reshape(n_states, n_inner).T)

    def _rotated(self, diagonal: Floats) -> Floats:
        """Return U diag U^T."""
        rotated: Floats = (self._axes * diagonal) @ self._axes.T
        return rotated

    def left(self, precision: Floats, vector: Floats) -> tuple[Floats, Floats]:
        """Return what ``_Frame.left`` returns."""
        precision += self._rotated(self._alpha)
        return precision, vector + self._axes @ self._between[0] if len(self._between) else vector

    def gain(self, inverse: Floats) -> Floats:
        """Return what ``_Frame.gain`` returns."""
        gain: Floats = ((inverse @ self._axes) * self._beta) @ self._axes.T
        return gain

    def right(self, gain: Floats, vector: Floats) -> tuple[Floats, Floats]:
        """Return what ``_Frame.right`` returns."""
        coupled = (self._axes * self._beta) @ (self._axes.T @ gain)
        end = self._end + self._between[-1] if len(self._between) else self._end
        return self._rotated(self._alpha + self._g) - coupled, self._axes @ end + vector @ gain

    def put_unseen(self, moments: _Moments, means: Floats, variances: Floats) -> None:
        """Put the unseen values of the run into means (T, n), and their variances into variances (T, g)."""
        mask, axes = self.mask, self._axes
        if not mask.unseen.size:
            return
        _put_frame(mask, self.last, moments.after, moments.covariance_after, means, variances)
        if not len(self._between):
            return
        frames = slice(self._first, self.last)
        # a_t, b_t and s_t by λ; whole = 1 − λ^{2n}
        t = np.arange(1, self._n)[:, None]
        done, left = -np.expm1(-2.0 * t * self._theta), -np.expm1(-2.0 * (self._n - t) * self._theta)
        ends = np.hstack([np.exp(-t * self._theta) * left, np.exp((t - self._n) * self._theta) * done])
        ends /= np.tile(self._whole, 2)
        spread = np.exp(-self._theta) * done * left / (-np.expm1(-2.0 * self._theta) * self._whole)
        n_states, n_columns = len(self._g), mask.blocks.shape[1]
        states = (
            self._between + ends[:, :n_states] * (moments.before @ axes) + ends[:, n_states:] * (moments.after @ axes)
        )
        # The covariance (2H, 2H) of both ends in the eigenvectors
        cross = axes.T @ moments.cross @ axes
        both = np.block(
            [[axes.T @ moments.covariance @ axes, cross], [cross.T, axes.T @ moments.covariance_after @ axes]]
        )
        for group, block in zip(mask.unseen.tolist(), mask.blocks, strict=True):
            rows = block @ axes
            means[frames, group * n_columns : (group + 1) * n_columns] = states @ rows.T
            # tr(X V X^T) = <X^T X, V>, V = diag(s_t) + (a_t b_t) cov (a_t b_t)^T
            square = rows.T @ rows
            weighted = (ends @ (np.tile(square, (2, 2)) * both) * ends).sum(axis=1)
            variances[frames, group] = (spread @ square.diagonal() + weighted) / n_columns


def _put_frame(mask: _Mask, frame: int, state: Floats, covariance: Floats, means: Floats, variances: Floats) -> None:
    """Put the unseen values of a frame into means (T, n), and their variances into variances (T, g)."""
    if mask.unseen.size:
        n_groups, n_columns, n_states = mask.blocks.shape
        means[frame].reshape(-1, n_columns)[mask.unseen] = mask.blocks @ state
        rows = mask.blocks.reshape(-1, n_states)
        squares = ((rows @ covariance) * rows).sum(axis=1)
        variances[frame, mask.unseen] = squares.reshape(n_groups, n_columns).sum(axis=1) / n_columns


class _Chain:
    """The nodes of a walk: its first frame, and the last frame of each run."""

    def __init__(self, walk: RandomWalk, values: Floats, masks: Masks) -> None:
        n_groups, n_states = masks.distinct.shape[1], walk.loadings.shape[1]
        groups = walk.loadings.reshape(n_groups, -1, n_states)
        total = walk.loadings.T @ walk.loadings / walk.noise_variance
        self._masks = [_Mask(seen, groups, total, walk.noise_variance) for seen in masks.distinct]
        self._vectors = values @ (walk.loadings / walk.noise_variance)
        self._index, self._start = masks.index, walk.start
        # Frames of a set of seen columns that is short in all are steps of their own.
        counts = np.bincount(masks.index[1:], minlength=len(self._masks))
        self._runs: list[tuple[int, int]] = []
        for first, stop in _constant_runs(masks.index, 1):
            if counts[masks.index[first]] >= _SHORTEST:
                self._runs.append((first, stop - 1))
            else:
                self._runs.extend((frame, frame) for frame in range(first, stop))

    def _run(self, k: int) -> "_Frame | _Run":
        first, last = self._runs[k]
        mask = self._masks[self._index[first]]
        return _Frame(mask, last, self._vectors) if first == last else _Run(mask, first, last, self._vectors)

    def from_the_end(self) -> Iterator[tuple["_Frame | _Run", _Moments]]:
        """Yield the runs from the last to the first, with the moments of the states at their ends.

        The first frame of the take comes last, as a run without a state before it.
        """
        n_states, n_runs = len(self._start), len(self._runs)
        step = max(_MOST_STORED_ENTRIES // (2 * n_states**2), 1)
        parts = [(first, min(first + step, n_runs)) for first in range(0, n_runs, step)]
        # Forwards: the state of the elimination before each part; the matrices of the last part are kept.
        first_mask = self._masks[self._index[0]]
        at = _Elimination(np.diag(self._start) + first_mask.information(), self._vectors[0].copy())
        begins: list[_Elimination] = []
        kept: list[tuple[_Frame | _Run, Floats, Floats, Floats]] = []
        for first, stop in parts:
            begins.append(at)
            kept, at = self._eliminate(first, stop, at, keep=stop == n_runs)
        covariance = _inverse(at.precision)
        state = covariance @ at.vector
        # Backwards: y_a = M⁻¹ r + gain y_b, cov(y_a, y_b) = gain cov(y_b), cov(y_a) = M⁻¹ + gain cov(y_b) gainᵀ
        for (first, stop), begin in zip(reversed(parts), reversed(begins), strict=True):
            if stop < n_runs:
                kept = self._eliminate(first, stop, begin, keep=True)[0]
            while kept:
                run, inverse, gain, mean = kept.pop()
                cross, before = gain @ covariance, mean + gain @ state
                earlier = inverse + cross @ gain.T
                yield run, _Moments(before, state, earlier, cross, covariance)
                state, covariance = before, earlier
        nothing = np.zeros((0, 0))
        yield _Frame(first_mask, 0, self._vectors), _Moments(nothing, state, nothing, nothing, covariance)

    def _eliminate(
        self, first: int, stop: int, at: "_Elimination", *, keep: bool
    ) -> tuple[list[tuple["_Frame | _Run", Floats, Floats, Floats]], "_Elimination"]:
        """Eliminate the nodes first to stop − 1; return for each its run, M⁻¹, gain and M⁻¹ r, and the next state."""
        kept: list[tuple[_Frame | _Run, Floats, Floats, Floats]] = []
        precision, vector = at.precision.copy(), at.vector
        for k in range(first, stop):
            run = self._run(k)
            precision, vector = run.left(precision, vector)
            inverse = _inverse(precision)
            gain = run.gain(inverse)
            if keep:
                kept.append((run, inverse, gain, inverse @ vector))
            precision, vector = run.right(gain, vector)
        return kept, _Elimination(precision, vector)


@dataclass(frozen=True)
class _Elimination:
    """What the eliminated nodes leave of the next one: its precision M (H, H), and its vector r (H,)."""

    precision: Floats
    vector: Floats


def _inverse(matrix: Floats) -> Floats:
    """Return the inverse of a positive definite matrix; LinAlgError where it is not."""
    factor, failed = scipy.linalg.lapack.dpotrf(matrix.T, lower=1)
    if failed:
        raise np.linalg.LinAlgError("The precision of a state must be positive definite.")
    half = scipy.linalg.lapack.dpotri(factor, lower=1, overwrite_c=1)[0]
    inverse: Floats = half + half.T
    inverse.ravel()[:: len(inverse) + 1] *= 0.5
    return inverse


def _constant_runs(index: Ints, begin: int) -> list[tuple[int, int]]:
    """Return the runs (start, stop), half open, of frames from ``begin`` on with one value of the index."""
    edges = np.flatnonzero(np.diff(index[begin:])) + 1 + begin
    stops = [*edges.tolist(), len(index)] if len(index) > begin else []
    return list(zip([begin, *edges.tolist()], stops, strict=False))
