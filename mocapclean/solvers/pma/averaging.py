"""The gaps of a take, filled marker by marker with the average of the predictors."""

import numpy as np
import scipy

from mocapclean.arrays import Bools, Floats, evenly_spaced, runs
from mocapclean.geometry.distances import mean_distances
from mocapclean.solvers import pca
from mocapclean.solvers.pma.padded_gap import PaddedGap
from mocapclean.solvers.pma.params import Params
from mocapclean.solvers.pma.reference_model import FEWEST_FRAMES, ROUNDING, ReferenceModel
from mocapclean.solvers.pma.sliding import median_mean
from mocapclean.solvers.pma.triads import spans

# No sweep of these was kept.
_DISTANCE_FRAMES = 5000  # most frames that the mean distances are taken over
_LINEAR_FRAMES = 500  # most frames that the linear regression learns from
_FEWEST_MARKERS = 4  # markers seen all through a gap that the linear regression needs
_LEAST_LIKELIHOOD = 1e-200  # of a predictor in a frame, so that the weights of a frame never sum to 0


def frames_in(seconds: float, rate: float) -> int:
    """Return the number of frames in a time, rounded up."""
    return int(np.ceil(seconds * rate))


class GapFiller:
    """The positions of a take about a travelling point while its gaps are being filled.

    local: (F, M, 3) millimetres. known: (F, M), trusted or filled. The gaps of the first ``n_own`` frames are filled.
    n_without_references: the gaps without three references.
    """

    def __init__(self, local: Floats, trusted: Bools, n_own: int, params: Params, rate: float) -> None:
        self.local, self.trusted, self.n_own, self.params = local.copy(), trusted, n_own, params
        self.known, self.n_without_references = trusted.copy(), 0
        self.distances, self.looseness = mean_distances(local, trusted, _DISTANCE_FRAMES)
        self.window = frames_in(params.weight_window, rate)
        self.pca_estimate, self.pca_filled, _ = pca.fill_local(
            local, trusted, n_own, pca.Params(bandwidth=params.bandwidth)
        )

    def order(self) -> list[int]:
        """Return the markers with gaps, the most present first, then by their first gap."""
        lost = ~self.trusted[: self.n_own]
        ranks = np.lexsort((lost.argmax(axis=0), lost.sum(axis=0)))
        return [int(k) for k in ranks if lost[:, k].any()]

    def fill(self, marker: int) -> None:
        """Fill all gaps of a marker, each from the state before the marker was filled."""
        known, local = self.trusted[:, marker].copy(), self.local[:, marker].copy()
        models: dict[tuple[int, ...], ReferenceModel] = {}
        for start, stop in runs(~self.trusted[: self.n_own, marker]):
            span = slice(max(int(start) - 1, 0), min(int(stop) + 1, self.n_own))
            gap = PaddedGap(marker, span, bool(start > 0), bool(stop < self.n_own))
            path = self._average(gap, models)
            if path is not None:
                local[start:stop], known[start:stop] = path[gap.inner], True
        self.local[:, marker], self.known[:, marker] = local, known

    def _average(self, gap: PaddedGap, models: dict[tuple[int, ...], ReferenceModel]) -> Floats | None:
        """Return the average path (n, 3) over the span of a gap, or None without a predictor.

        models: those of the marker so far, by references; a new one is added.
        """
        references = self._references(gap)
        paths = [path for path in (self._linear(gap), self._principal_components(gap)) if path is not None]
        if references is None:
            self.n_without_references += 1
            return _even_mean(paths) if paths else None
        if references not in models:
            trusted = self.trusted[:, gap.marker]
            models[references] = ReferenceModel(self.local, self.known, trusted, gap.marker, references, self.params)
        model = models[references]
        triads = self.local[gap.span][:, list(references)].swapaxes(0, 1)
        paths = [*model.paths(gap, self.local[gap.span, gap.marker], triads), *paths]
        if not paths:
            return None
        if not model.enough:
            return _even_mean(paths)
        average = _weighted_mean(paths, [model.likelihood(path, triads) for path in paths], self.window)
        return model.constrained(average, triads) if self.params.space_constraint else average

    def _present(self, gap: PaddedGap) -> Bools:
        """Return the other markers (M,) known all through the span."""
        present: Bools = np.all(self.known[gap.span], axis=0)
        present[gap.marker] = False
        return present

    def _references(self, gap: PaddedGap) -> tuple[int, ...] | None:
        """Return the three stiffest markers known all through the span that span a plane in all of it."""
        looseness, distance = self.looseness[gap.marker], self.distances[gap.marker]
        present = self._present(gap) & np.isfinite(looseness)
        if present.sum() < 3:
            return None
        # Markers that are equally loose but for rounding are ordered by their distance.
        levels = np.round(looseness / (ROUNDING * distance[present].max() or 1.0))
        first, second, *others = (int(k) for k in np.lexsort((distance, levels)) if present[k])
        points = self.local[gap.span]
        for third in others:
            if spans(points[:, first], points[:, second], points[:, third]):
                return first, second, third
        return None

    def _linear(self, gap: PaddedGap) -> Floats | None:
        """Return the path of a linear regression on the markers known all through the span, or None."""
        if "linear" not in self.params.methods:
            return None
        present = np.flatnonzero(self._present(gap))
        stiff = present[self.looseness[gap.marker, present] <= self.params.loosest]
        predictors = stiff if stiff.size else present
        frames = np.flatnonzero(self.trusted[:, gap.marker] & np.all(self.known[:, predictors], axis=1))
        if len(present) < _FEWEST_MARKERS or len(frames) < FEWEST_FRAMES:
            return None
        frames = frames[evenly_spaced(len(frames), _LINEAR_FRAMES)]
        features, values = self.local[frames][:, predictors].reshape(len(frames), -1), self.local[frames, gap.marker]
        middle, centre = features.mean(axis=0), values.mean(axis=0)
        slopes = scipy.linalg.lstsq(
            features - middle, values - centre, cond=ROUNDING, lapack_driver="gelsy", check_finite=False
        )[0]
        path = centre + (self.local[gap.span][:, predictors].reshape(-1, 3 * len(predictors)) - middle) @ slopes
        return gap.meeting(path, self.local[gap.span, gap.marker])

    def _principal_components(self, gap: PaddedGap) -> Floats | None:
        """Return the path of ``pca``, or None.

        It has no estimate of the trusted samples, so its first and last frame in the gap are compared with these.
        """
        if "pca" not in self.params.methods or not self.pca_filled[gap.span, gap.marker][gap.inner].all():
            return None
        path, known = self.pca_estimate[gap.span, gap.marker], self.local[gap.span, gap.marker]
        inside = path[gap.inner]
        corrected = gap.without_ramp(path, inside[0] - known[0], inside[-1] - known[-1])
        return np.concatenate([known[: gap.left], corrected[gap.inner], known[len(known) - gap.right :]])


def _even_mean(paths: list[Floats]) -> Floats:
    return np.asarray(np.mean(paths, axis=0))


def _weighted_mean(paths: list[Floats], likelihoods: list[Floats], window: int) -> Floats:
    """Return Σ w_i x̂_i / Σ w_i of paths (n, 3), the likelihoods (n,) smoothed over a window of frames."""
    n_frames = len(paths[0])
    weights = np.maximum(np.array(likelihoods), _LEAST_LIKELIHOOD).T
    weights = median_mean(weights, min(window, (n_frames - 1) // 2))
    average: Floats = np.einsum("ni,ind->nd", weights, np.array(paths)) / weights.sum(axis=1, keepdims=True)
    return average
