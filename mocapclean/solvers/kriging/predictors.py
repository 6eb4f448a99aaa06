"""The predictors of a marker: on which neighbours a frame of reference rests, and what the features in it are."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Predictor:
    """A frame of reference and the features in it, from which regression kriging predicts a marker.

    n_framing: neighbours that the frame is aligned with; 0 for one that shifts with the mean of all without turning.
    n_features: neighbours whose places in the frame are features.
    looseness: times the rigidity parameter, the SD of a distance below which neighbours weigh alike in the frame.
    hinged: whether the frame is that of a joint between two rigid neighbours (``hinge``).
    n_poses: radial basis features that are added, each the nearness to one pose; 0 for none.
    """

    n_framing: int
    n_features: int
    looseness: float = 1.0
    hinged: bool = False
    n_poses: int = 0


PREDICTORS = (
    Predictor(12, 12, n_poses=20),  # a segment and its surroundings; the poses gained 1 %
    Predictor(6, 6),  # the rigid core of a segment
    Predictor(24, 24, 5.0),  # most of a body, as one loose frame
    Predictor(4, 24),  # a frame on the nearest few, the body as features
    Predictor(0, 24),  # a frame that does not turn, where no segment is rigid
    Predictor(10, 10, n_poses=30),  # nonlinear in the pose; gained 2 % on real markers with 6 neighbours and 20 poses
    Predictor(6, 12, hinged=True),  # a joint such as a knee, which was 60 mm off on hops without this one
    Predictor(12, 24, hinged=True),  # the same joint from more of the body
)
"""All predictors; neighbours are taken in descending order of their weight.

They were chosen one after the other on the captures of `mocapclean bench markers`; the gains are those at the time.
"""


def applicable(n_neighbours: int, has_hinge: bool) -> list[Predictor]:
    """Return the predictors that so many neighbours allow, with their numbers limited to it, without duplicates.

    A frame that turns needs three neighbours, a hinged one also two ends.
    """
    limited = [
        replace(p, n_framing=min(p.n_framing, n_neighbours), n_features=min(p.n_features, n_neighbours))
        for p in PREDICTORS
    ]
    usable = [p for p in limited if (p.n_framing == 0 or n_neighbours >= 3) and (has_hinge or not p.hinged)]
    return list(dict.fromkeys(usable))
