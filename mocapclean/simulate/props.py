"""Props that hide markers from cameras, as text: ``box:``, ``cylinder:`` or ``capsule:``, and millimetres."""

import numpy as np

from mocapclean.errors import UsageError
from mocapclean.geometry.occluders import Box, Capsules, Cylinder, Occluder

_COUNTS = {"box": 6, "cylinder": 7, "capsule": 7}
"""Numbers of each kind: two corners of a box; both ends of an axis and a radius."""


def prop(text: str) -> Occluder:
    """Return the occluder of a text such as ``cylinder:0,0,0,0,0,800,300``, which does not move.

    A box has two opposite corners; a cylinder and a capsule have both ends of their axis and a radius. Raises
    UsageError for another kind, another count of numbers, or a solid without volume.
    """
    kind, _, rest = text.partition(":")
    try:
        numbers = np.array([float(part) for part in rest.split(",")])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != _COUNTS.get(kind) or not np.isfinite(numbers).all():
        raise UsageError(
            "A prop must be box:x,y,z,x,y,z (two corners), cylinder:x,y,z,x,y,z,r or capsule:x,y,z,x,y,z,r, in mm. "
            f"Got {text}."
        )
    first, second = numbers[:3], numbers[3:6]
    if kind == "box":
        low, high = np.minimum(first, second), np.maximum(first, second)
        if not (low < high).all():
            raise UsageError(f"The corners of a box must differ along every axis. Got {text}.")
        return Box(low=low, high=high)
    radius = float(numbers[6])
    if radius <= 0 or (kind == "cylinder" and (first == second).all()):
        raise UsageError(f"A {kind} must have a positive radius and length. Got {text}.")
    if kind == "cylinder":
        return Cylinder(first=first, second=second, radius=radius)
    return Capsules(ends=np.stack([first, second])[None, None], radii=np.full((1, 1), radius))
