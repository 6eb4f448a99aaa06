"""The regression models of a marker, called predictors: neighbours define the moving axes or serve as inputs."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Predictor:
    """A frame of reference and the features in it, from which regression kriging predicts a marker.

    n_framing: neighbours that the frame is aligned with; 0 for one that shifts with the mean of all without turning.
    n_features: neighbours whose positions in the frame are features.
    hinged: whether the frame is that of a joint between two rigid neighbours (``hinge``).
    n_poses: radial basis features that are added, each the nearness to one pose; 0 for none.
    moving: whether the displacements of the neighbours around each frame are features too.
    """

    n_framing: int
    n_features: int
    hinged: bool = False
    n_poses: int = 0
    moving: bool = False


PREDICTORS = (
    Predictor(10, 10, n_poses=30),  # a segment and its surroundings, nonlinear in the pose
    Predictor(6, 6, n_poses=20),  # the rigid core of a segment, nonlinear in the pose
    Predictor(4, 16),  # a frame on the nearest few, half of a body as features
    Predictor(0, 24),  # a frame that does not turn, and most of a body
    Predictor(6, 12, hinged=True),  # a joint such as a knee; without it a knee was 60 mm off in hops
)
"""The predictors of all segments; neighbours are taken in descending order of their weight.

They and that of short segments were chosen among 27 on the first half of the takes of ``mocapclean bench markers``,
with eleven patterns of gaps. Eight, with more neighbours each, cost 1.6 times as much and had the same error.
"""

IN_SHORT_SEGMENTS = (Predictor(6, 6),)
"""The predictors of short segments alone: the rigid core of a body segment."""

IN_LONG_SEGMENTS = (
    Predictor(6, 12, moving=True),  # a segment and its surroundings, and how they move
    Predictor(10, 10, n_poses=30, moving=True),  # the same, nonlinear in pose and motion
)
"""The predictors of long segments alone.

They were chosen among fifteen sets on the first half of the takes of ``mocapclean bench occlusion``: with them the
error in clusters, at ends and in 30 frames was 3.0 % less there, and 2.0 % less on the other half. Without any one of
the predictors of all segments it was at least 0.7 % more.
"""


def applicable(n_neighbours: int, has_hinge: bool, *, is_long: bool) -> list[Predictor]:
    """Return the predictors that differ with so many neighbours, and that these and a long or short segment allow.

    With few neighbours ``n_framing`` and ``n_features`` are limited, which can make predictors equal. A frame that
    turns needs three neighbours. A hinged frame needs two ends among them.
    """
    if not n_neighbours:
        return []
    every = PREDICTORS + (IN_LONG_SEGMENTS if is_long else IN_SHORT_SEGMENTS)
    usable = [p for p in every if (p.n_framing == 0 or n_neighbours >= 3) and (has_hinge or not p.hinged)]
    distinct: dict[Predictor, Predictor] = {}
    for p in usable:
        n_framing, n_features = min(p.n_framing, n_neighbours), min(p.n_features, n_neighbours)
        distinct.setdefault(replace(p, n_framing=n_framing, n_features=n_features), p)
    return list(distinct.values())
