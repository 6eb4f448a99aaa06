"""Solids that block the view from a camera to points: capsules, boxes and cylinders. All lengths are millimetres."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mocapclean.arrays import Bools, Floats

_CHUNK = 128  # frames whose distances are in memory at a time; chosen for speed
_TINY = 1e-9  # mm², squared length below which a segment is a point; avoids a division by zero


def _dot(first: Floats, second: Floats) -> Floats:
    """Return the products of vectors along the last axis."""
    return np.asarray(np.einsum("...c,...c->...", first, second))


class Occluder(Protocol):
    """Something that blocks views."""

    def blocks(self, camera: Floats, points: Floats) -> Bools:
        """Return whether the view from a camera (3,) to each of the points (F, M, 3) is blocked, (F, M)."""


@dataclass(frozen=True, kw_only=True)
class Capsules:
    """K capsules: all points nearer to a segment than its radius.

    ends: (F, K, 2, 3) of the segments in each frame, or (1, K, 2, 3) if they do not move. radii: (F, K) or (1, K). A
    capsule with a NaN blocks nothing in that frame.
    """

    ends: Floats
    radii: Floats

    def blocks(self, camera: Floats, points: Floats) -> Bools:
        """Return whether the view from a camera (3,) to each of the points (F, M, 3) is blocked, (F, M)."""
        blocked = np.zeros(points.shape[:2], dtype=bool)
        for start in range(0, len(points), _CHUNK):
            frames = slice(start, start + _CHUNK)
            ends, radii = (a if len(a) == 1 else a[frames] for a in (self.ends, self.radii))
            views = points[frames]
            frame, marker, capsule = np.nonzero(_may_block(camera, views, ends, radii))
            moving = frame if len(ends) > 1 else np.zeros_like(frame)
            near = ends[moving, capsule]
            squared = segment_distances(camera, views[frame, marker], near[:, 0], near[:, 1])
            hit = squared < np.square(radii[moving, capsule])
            blocked[start + frame[hit], marker[hit]] = True
        return blocked


def _may_block(camera: Floats, points: Floats, ends: Floats, radii: Floats) -> Bools:
    """Return whether the views from a camera to points (F, M, 3) meet the balls about capsules, (F, M, K)."""
    along, offset = points - camera, ends.mean(axis=2) - camera
    reach = radii + np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2) / 2.0
    squared_length = np.maximum(_dot(along, along), _TINY)[:, :, None]
    product = along @ offset.transpose(0, 2, 1)
    share = np.clip(product / squared_length, 0.0, 1.0)
    excess = share * (share * squared_length - 2.0 * product)
    return np.asarray(excess < (np.square(reach) - _dot(offset, offset))[:, None])


def segment_distances(start: Floats, stops: Floats, first: Floats, second: Floats) -> Floats:
    """Return the squared distances (n,), mm², of segments from ``start`` to ``stops`` from those between two ends.

    All arrays are (n, 3) or (3,). The closest points of two segments after C. Ericson, "Real-Time Collision Detection",
    2005, section 5.1.9.
    """
    along, axis, offset = stops - start, second - first, start - first
    a, e = np.maximum(_dot(along, along), _TINY), np.maximum(_dot(axis, axis), _TINY)
    b, c, f = _dot(along, axis), _dot(along, offset), _dot(axis, offset)
    # s and t are the closest points as shares of the lengths; where t leaves its segment, s follows from t.
    s = np.clip((b * f - c * e) / np.maximum(a * e - b * b, _TINY), 0.0, 1.0)
    t = np.clip((b * s + f) / e, 0.0, 1.0)
    s = np.clip((b * t - c) / a, 0.0, 1.0)
    between = offset + s[..., None] * along - t[..., None] * axis
    return _dot(between, between)


def point_distances(points: Floats, first: Floats, second: Floats) -> Floats:
    """Return the squared distances (F, M, K), mm², of points (F, M, 3) from segments between two ends (F, K, 3)."""
    axis = second - first
    squared_length = np.maximum(_dot(axis, axis), _TINY)[:, None]
    offset = points[:, :, None] - first[:, None]
    along = _dot(offset, axis[:, None])
    share = np.clip(along / squared_length, 0.0, 1.0)
    return np.asarray(_dot(offset, offset) + share * (share * squared_length - 2.0 * along))


@dataclass(frozen=True, kw_only=True)
class Box:
    """A box parallel to the axes, between two corners (3,)."""

    low: Floats
    high: Floats

    def blocks(self, camera: Floats, points: Floats) -> Bools:
        """Return whether the view from a camera (3,) to each of the points (F, M, 3) is blocked, (F, M)."""
        enter, leave = _slab(camera, points - camera, self.low, self.high)
        return np.asarray(np.maximum(enter.max(axis=-1), 0.0) < np.minimum(leave.min(axis=-1), 1.0))


@dataclass(frozen=True, kw_only=True)
class Cylinder:
    """A cylinder with flat ends: the centres (3,) of both, and the radius."""

    first: Floats
    second: Floats
    radius: float

    def blocks(self, camera: Floats, points: Floats) -> Bools:
        """Return whether the view from a camera (3,) to each of the points (F, M, 3) is blocked, (F, M)."""
        length = float(np.linalg.norm(self.second - self.first))
        axis = (self.second - self.first) / length
        along, offset = points - camera, camera - self.first
        enter, leave = _slab(offset @ axis, along @ axis, np.zeros(()), np.full((), length))
        # Across the axis: the roots of |offset + s along|² = radius²
        across, aside = along - (along @ axis)[..., None] * axis, offset - (offset @ axis) * axis
        a = np.maximum(_dot(across, across), _TINY)
        half, c = across @ aside, float(aside @ aside) - self.radius**2
        root = half**2 - a * c
        middle, reach = -half / a, np.sqrt(np.maximum(root, 0.0)) / a
        first = np.maximum(np.maximum(enter, middle - reach), 0.0)
        last = np.minimum(np.minimum(leave, middle + reach), 1.0)
        return np.asarray((root > 0) & (first < last))


def _slab(start: Floats, along: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Return the shares of lines at which they enter and leave a slab between two planes; enter > leave if never.

    They are infinite for a line parallel to the planes, and NaN for one in a plane, which no comparison finds inside.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (low - start) / along, (high - start) / along
    return np.minimum(one, other), np.maximum(one, other)
