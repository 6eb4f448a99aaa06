"""Occlusion by ray casting: which markers of a body at least two of the cameras around it see.

The body is made of capsules under the skin. Below each marker is a ball that touches the skin from inside, and capsules
join the balls of neighbouring markers. So a marker hides from the cameras behind its segment, and a limb hides the
markers behind it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.geometry.distances import mean_distances
from mocapclean.geometry.occluders import Capsules, Occluder, point_distances
from mocapclean.geometry.upright import up_axis
from mocapclean.simulate.bounds import require_whole
from mocapclean.take import Take

N_CAMERAS = 8
"""Cameras by default, as many as a small laboratory has; chosen by hand."""

FEWEST_CAMERAS, MOST_CAMERAS = 2, 64

_MARGIN = 2500.0  # mm, horizontal distance of the cameras from the volume; chosen by hand
_HEIGHTS = (700.0, 2800.0)  # mm, lowest and highest camera above the floor; chosen by hand
_JITTER = 0.3  # of a camera's place on the ring, in distances between cameras; chosen by hand
_LEAST_ANGLE = 20.0  # degrees, between two lines of sight (and from 180) that give a position; chosen by hand

# Chosen on the first half of the takes of `bench occlusion`: with the whole extent and 23 degrees less is lost at the
# ends of a take, and fewer neighbours together, than in captures. benchmarks/gap_statistics.py has the figures.
_VOLUME = 0.6  # of the take's extent, the part around which the cameras stand and at which they look
_HALF_FIELD = 20.0  # degrees, half the field of a camera
_AIM = 0.8  # of the volume's half size, the farthest from its centre that a camera looks; chosen by hand

_DISTANCE_FRAMES = 200  # most frames of the distances between markers; chosen for speed
_CHUNK = 64  # frames whose distances from capsules are in memory at a time; chosen for speed
_RADII = (15.0, 60.0)  # mm, least and largest radius of a ball: a finger, a thigh; chosen by hand
_RADIUS_SHARE = 0.4  # of the distance to the nearest marker, the radius of a ball; chosen by hand
_SKIN = 0.9  # of the distance of the nearest marker from its axis, the radius of a capsule; chosen by hand
_INWARD_SCALE = 200.0  # mm, distance over which markers lose weight in the centre that a marker faces away from
_NEIGHBOURS = 4  # markers to which a marker's ball is joined; chosen by hand
_SPREAD = 0.2  # of a distance, the largest SD of joined markers; chosen by hand, hip and shoulder stay joined


def occlude_by_cameras(
    take: Take, rng: np.random.Generator, n_cameras: int = N_CAMERAS, props: Sequence[Occluder] = ()
) -> Bools:
    """Return missing samples (F, M): those that fewer than two of ``n_cameras`` see past the body and the props.

    The cameras stand in a ring around the middle of the take's volume, and each has a limited field. Only trusted
    positions are read, and a sample without one is not missing here. Raises UsageError unless there are 2 to 64
    cameras.
    """
    require_whole("The number of cameras", n_cameras, FEWEST_CAMERAS, MOST_CAMERAS)
    if not take.trusted.any():
        return np.zeros_like(take.trusted)
    occluders = [body_of(take), *props]
    return take.trusted & ~seen(camera_ring(take, rng, n_cameras), take.positions, occluders)


@dataclass(frozen=True)
class Cameras:
    """The places (n, 3) of cameras, mm, and the unit vectors (n, 3) along which they look."""

    places: Floats
    axes: Floats

    def views(self, points: Floats, occluders: Sequence[Occluder]) -> Bools:
        """Return which of the points (F, M, 3) each camera sees in its field and past the occluders, (F, M, n)."""
        rays = rays_of(self.places, points)
        views = np.einsum("fmnc,nc->fmn", rays, self.axes) >= np.cos(np.radians(_HALF_FIELD))
        for k, camera in enumerate(self.places):
            for occluder in occluders:
                views[:, :, k] &= ~occluder.blocks(camera, points)
        return np.asarray(views)


def rays_of(places: Floats, points: Floats) -> Floats:
    """Return the unit vectors (F, M, n, 3) from cameras at ``places`` (n, 3) to points (F, M, 3)."""
    rays = points[:, :, None] - places
    return np.asarray(rays / np.maximum(np.linalg.norm(rays, axis=-1, keepdims=True), 1.0))


def camera_ring(take: Take, rng: np.random.Generator, n_cameras: int) -> Cameras:
    """Return cameras in an ellipse around the middle of the trusted samples, each of which looks into it."""
    up = up_axis(take.positions, take.trusted)
    points = take.positions[take.trusted]
    low, high = points.min(axis=0), points.max(axis=0)
    half = _VOLUME * (high - low) / 2
    across = [axis for axis in range(3) if axis != up]
    turns = rng.random() + (np.arange(n_cameras) + rng.uniform(-_JITTER, _JITTER, n_cameras)) / n_cameras
    directions = np.stack([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)], axis=1)
    places = np.empty((n_cameras, 3))
    places[:, across] = ((low + high) / 2)[across] + directions * (half[across] + _MARGIN)
    places[:, up] = low[up] + rng.uniform(*_HEIGHTS, n_cameras)
    axes = (low + high) / 2 + rng.uniform(-_AIM, _AIM, (n_cameras, 3)) * half - places
    return Cameras(places, axes / np.linalg.norm(axes, axis=1, keepdims=True))


def seen(cameras: Cameras, points: Floats, occluders: Sequence[Occluder]) -> Bools:
    """Return whether at least two cameras at a useful angle see each of the points (F, M, 3), (F, M).

    A useful angle is between 20 and 160 degrees: it gives a position.
    """
    views, rays = cameras.views(points, occluders), rays_of(cameras.places, points)
    most = np.cos(np.radians(_LEAST_ANGLE))
    found = np.zeros(points.shape[:2], dtype=bool)
    for k in range(1, len(cameras.places)):
        useful = np.abs(np.einsum("fmnc,fmc->fmn", rays[:, :, :k], rays[:, :, k])) <= most
        found |= views[:, :, k] & (views[:, :, :k] & useful).any(axis=2)
    return found


# The body


def body_of(take: Take) -> Capsules:
    """Return the capsules of a body: balls under the markers, joined between neighbours of nearly constant distance.

    A capsule blocks nothing in frames in which a marker of it is not trusted.
    """
    mean, deviation = mean_distances(take.positions, take.trusted, _DISTANCE_FRAMES)
    np.fill_diagonal(mean, np.inf)
    positions = np.where(take.trusted[..., None], take.positions, np.nan)
    radii = np.clip(_RADIUS_SHARE * mean.min(axis=1), *_RADII)
    centres = positions + radii[:, None] * _inward(take, mean)
    pairs = _joined(mean, deviation)
    ends = centres[:, pairs]
    return Capsules(ends=ends, radii=_fitted(positions, ends, radii[pairs].min(axis=1)))


def _inward(take: Take, mean: Floats) -> Floats:
    """Return unit vectors (F, M, 3) from each marker to the centre of those about it, in which near ones count most."""
    weights = np.exp(-mean / _INWARD_SCALE)
    known = take.trusted.astype(np.float64)
    total = known @ weights.T
    positions = np.where(take.trusted[..., None], take.positions, 0.0)
    centre = np.einsum("mk,fkc->fmc", weights, positions) / np.maximum(total, 1e-12)[..., None]
    inward = centre - positions
    length = np.linalg.norm(inward, axis=2, keepdims=True)
    return np.asarray(inward / np.maximum(length, 1e-9))


def _joined(mean: Floats, deviation: Floats) -> Ints:
    """Return the pairs (K, 2) of joined balls: each with itself, and near ones whose distance varies little."""
    near = np.argsort(mean, axis=1, kind="stable")[:, :_NEIGHBOURS]
    linked = np.eye(len(mean), dtype=bool)
    for marker, others in enumerate(near):
        close = others[deviation[marker, others] <= _SPREAD * mean[marker, others]]
        linked[np.minimum(marker, close), np.maximum(marker, close)] = True
    return np.argwhere(linked)


def _fitted(positions: Floats, ends: Floats, radii: Floats) -> Floats:
    """Return the radii (F, K) of capsules, at most those given (K,) and so small that no marker is inside one."""
    fitted = np.empty(ends.shape[:2])
    for start in range(0, len(positions), _CHUNK):
        frames = slice(start, start + _CHUNK)
        squared = point_distances(positions[frames], ends[frames, :, 0], ends[frames, :, 1])
        nearest = np.fmin.reduce(squared, axis=1, initial=np.inf)
        fitted[frames] = np.minimum(radii, _SKIN * np.sqrt(np.maximum(nearest, 0.0)))
    return fitted
