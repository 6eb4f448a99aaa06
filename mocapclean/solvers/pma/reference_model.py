"""The model of a marker relative to three reference markers: regressions on their shape, and its distances to them."""

from collections.abc import Callable, Iterator

import numpy as np
import scipy

from mocapclean.arrays import Bools, Floats, evenly_spaced
from mocapclean.solvers.pma.kernels import Density, kernel_regression
from mocapclean.solvers.pma.padded_gap import PaddedGap
from mocapclean.solvers.pma.params import Params, Predictor
from mocapclean.solvers.pma.triads import triad_frames

_SHAPE_FRAMES = 1000  # most frames that the regressions on the shape learn from; no sweep was kept
_DENSITY_FRAMES = 500  # most frames that the density of a distance comes from; no sweep was kept
FEWEST_FRAMES = 10  # frames that a regression needs; no sweep was kept
ROUNDING = 1e-6  # a variation below this share of the size of a quantity is rounding; no sweep was kept
_PERCENTILES = [0.01, 0.99]  # of the known distances, as printed
_SWEEPS = 5  # rounds over the three references that move a path to allowed distances; no sweep was kept


class ReferenceModel:
    """The place of a marker relative to three references, learned from the frames in which all four are known.

    local: (F, M, 3). known: (F, M), trusted or filled. trusted: (F,) of the marker. references: the columns of the
    three. enough: whether the frames are enough to learn more than a straight line.
    """

    def __init__(
        self, local: Floats, known: Bools, trusted: Bools, marker: int, references: tuple[int, ...], params: Params
    ) -> None:
        frames = np.flatnonzero(trusted & np.all(known[:, list(references)], axis=1))
        self.params, self.enough = params, len(frames) >= FEWEST_FRAMES
        if not self.enough:
            return
        # The standardised local coordinates of the marker, and the shape of the references
        chosen = frames[evenly_spaced(len(frames), _SHAPE_FRAMES)]
        triads = local[chosen][:, list(references)].swapaxes(0, 1)
        place = _to_local(triads, local[chosen, marker])
        self.centre, self.scale = place.mean(axis=0), place.std(axis=0)
        self.scale = np.where(self.scale > 0.0, self.scale, 1.0)
        shape = _shape(triads)
        size = float(np.abs(shape).max())
        # The regressors of both regressions, and the slopes of the quadratic one
        self.linear, self.quadratic = Standardiser(shape, size), Standardiser(_products(shape), size**2)
        self.features, self.targets = self.linear.scale(shape), (place - self.centre) / self.scale
        design = _with_constant(self.quadratic.scale(_products(shape)))
        self.slopes = scipy.linalg.lstsq(
            design, self.targets, cond=ROUNDING, lapack_driver="gelsy", check_finite=False
        )[0]
        # The distances |x − P_k| (n, 3): their percentiles, and p_k
        distances = np.linalg.norm(local[frames][:, list(references)] - local[frames, marker][:, None], axis=-1)
        self.bounds = np.quantile(distances, _PERCENTILES, axis=0, method="hazen")
        samples = distances[evenly_spaced(len(frames), _DENSITY_FRAMES)]
        self.densities = [Density(column) for column in samples.T]

    def paths(self, gap: PaddedGap, known: Floats, triads: Floats) -> Iterator[Floats]:
        """Yield the paths (n, 3) of the predictors over the span of a gap.

        known: (n, 3), read at the ends of the span. triads: (3, n, 3), the references.
        """
        place = _to_local(triads, known)
        regressions: dict[Predictor, Callable[[Floats], Floats]] = {
            "polynomial": self._polynomial,
            "kernel": self._kernel,
        }
        if "local" in self.params.methods and (gap.left or gap.right):
            yield _to_world(triads, gap.meeting(np.zeros_like(place), place))
        for name, predict in regressions.items():
            if self.enough and name in self.params.methods:
                path = self.centre + self.scale * predict(_shape(triads))
                yield _to_world(triads, gap.meeting(path, place))

    def _polynomial(self, shape: Floats) -> Floats:
        predicted: Floats = _with_constant(self.quadratic.scale(_products(shape))) @ self.slopes
        return predicted

    def _kernel(self, shape: Floats) -> Floats:
        return kernel_regression(self.features, self.targets, self.linear.scale(shape), self.params.spread)

    def likelihood(self, path: Floats, triads: Floats) -> Floats:
        """Return w = Π_k p_k(|x̂ − P_k|), (n,), of a path (n, 3) with the references (3, n, 3)."""
        distances = np.linalg.norm(triads - path, axis=-1)
        product: Floats = np.prod([p.at(d) for p, d in zip(self.densities, distances, strict=True)], axis=0)
        return product

    def constrained(self, path: Floats, triads: Floats) -> Floats:
        """Return the path (n, 3) moved along its lines to the references until its distances are in the known range."""
        path = path.copy()
        least, most = self.bounds
        for _ in range(_SWEEPS):
            distances = np.linalg.norm(triads - path, axis=-1)
            outside = np.flatnonzero(((distances < least[:, None]) | (distances > most[:, None])).any(axis=0))
            if not outside.size:
                break
            # P_3, P_2, P_1 in turn, so that the stiffest reference comes last
            for k in (2, 1, 0):
                arms = path[outside] - triads[k, outside]
                length = np.linalg.norm(arms, axis=-1, keepdims=True)
                allowed = np.clip(length, least[k], most[k])
                path[outside] = triads[k, outside] + arms * (allowed / np.where(length > 0.0, length, 1.0))
        return path


class Standardiser:
    """The step from features (N, k) to mean 0 and standard deviation 1; features that vary by rounding become 0."""

    def __init__(self, features: Floats, size: float) -> None:
        deviation = features.std(axis=0)
        self.mean, self.deviation = features.mean(axis=0), np.where(deviation > ROUNDING * size, deviation, np.inf)

    def scale(self, features: Floats) -> Floats:
        """Return other features (n, k), less the mean, divided by the standard deviation."""
        scaled: Floats = (features - self.mean) / self.deviation
        return scaled


def _to_local(triads: Floats, positions: Floats) -> Floats:
    """Return positions (n, 3) in the coordinates of the references (3, n, 3)."""
    return triad_frames(*triads).to_local(positions[:, None])[:, 0]


def _to_world(triads: Floats, positions: Floats) -> Floats:
    """Return positions (n, 3) in the coordinates of the references (3, n, 3) as positions in those of the take."""
    return triad_frames(*triads).to_world(positions[:, None])[:, 0]


def _shape(triads: Floats) -> Floats:
    """Return the shape (n, 3) of the references: |P_1 P_2| and the two coordinates of P_3 in their plane."""
    length = np.linalg.norm(triads[1] - triads[0], axis=-1)
    third = _to_local(triads, triads[2])
    return np.column_stack([length, third[:, 0], third[:, 2]])


def _products(shape: Floats) -> Floats:
    """Return the features (n, 9) of a quadratic function of three variables, less the constant."""
    first, second = np.triu_indices(3)
    return np.hstack([shape, shape[:, first] * shape[:, second]])


def _with_constant(features: Floats) -> Floats:
    return np.hstack([np.ones((len(features), 1)), features])
