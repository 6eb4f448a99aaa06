"""Print what one pose for each rigid segment would make of the fills of neighbours that are lost together.

    python benchmarks/rigid_segments.py FOLDER [--seeds 4]

The takes and clusters are those of ``mocapclean bench occlusion``. The markers of a segment have distances with an SD
up to a limit. In each frame their mean shape is turned and shifted to the answers of the default method, and to the
measured markers of the segment, by least squares in units of their SD. Printed for each cluster, limit and share of the
way from the answer to the shape: the geometric mean of the ratio of the errors after and before. Also the share of the
square error of a segment that is left when the true motion of the segment as a rigid body is put in.
"""

import argparse
import warnings
from collections import defaultdict
from pathlib import Path

import numpy as np

import mocapclean
from mocapclean.config.settings import DEFAULT_METHOD
from mocapclean.experiments import occlusion
from mocapclean.experiments.markers import labelled
from mocapclean.experiments.trials import Entry, solve
from mocapclean.geometry.distances import mean_distances

CLUSTERS = [pattern for pattern in occlusion.PATTERNS if isinstance(pattern, occlusion.Cluster)]
LIMITS = (3.0, 6.0)  # mm, largest SD of a distance within a segment
SHARES = (0.5, 1.0)  # of the way from the answers to the shape
NOISE = 0.3  # mm, SD of a measured marker
FRAMES = 600  # most frames over which distances are measured


def placed(shape, points, weights):
    """Return a shape (F, k, 3) turned and shifted to points (F, k, 3) by weighted least squares (Kabsch 1976)."""
    weights = (weights / weights.sum(axis=1, keepdims=True))[..., None]
    middle, centre = (np.sum(weights * each, axis=1, keepdims=True) for each in (shape, points))
    left, _, right = np.linalg.svd(np.swapaxes(shape - middle, 1, 2) @ (weights * (points - centre)))
    left = (
        left * np.stack([np.ones(len(left)), np.ones(len(left)), np.sign(np.linalg.det(left @ right))], axis=1)[:, None]
    )
    return (shape - middle) @ left @ right + centre


def segments(deviation, filled, limit):
    """Yield the columns of each segment: at least two filled markers, then the measured ones, at least three in all."""
    lost = np.flatnonzero(filled.any(axis=0)).tolist()
    left = set(lost)
    for first in lost:
        if first not in left:
            continue
        members = [first]
        for other in sorted(left - {first}):
            if (deviation[other, members] <= limit).all():
                members.append(other)
        left -= set(members)
        seen = [c for c in range(len(deviation)) if c not in lost and (deviation[c, members] <= limit).all()]
        if len(members) > 1 and len(members + seen) > 2:
            yield members + seen


def mean_shape(positions):
    """Return the mean (k, 3) of positions (F, k, 3) that are turned and shifted to each other."""
    shape = positions[0]
    for _ in range(3):
        shape = placed(positions, np.broadcast_to(shape, positions.shape), np.ones(positions.shape[:2])).mean(axis=0)
    return shape


def trial(truth, pattern, seed, ratios, rests):
    """Add the logarithms of the ratios of a trial, and the shares of the square error that are left."""
    hidden = pattern.hidden(truth, seed)
    solution, _ = solve(truth, hidden, Entry(method=DEFAULT_METHOD))
    filled, known = hidden & solution.filled, truth.trusted & ~hidden
    if not filled.any():
        return
    deviation = mean_distances(truth.positions, known, FRAMES)[1]
    before = np.square(solution.positions - truth.positions)[filled].mean()
    for limit in LIMITS:
        moved = {share: solution.positions.copy() for share in SHARES}
        for members in segments(deviation, filled, limit):
            learnt = np.flatnonzero(known[:, members].all(axis=1))
            frames = np.flatnonzero(filled[:, members].any(axis=1) & (filled | known)[:, members].all(axis=1))
            if len(learnt) < 30 or not len(frames):
                continue
            own = filled[frames][:, members]
            answers = np.where(filled[..., None], solution.positions, truth.positions)[frames][:, members]
            sd = np.hypot(np.where(own, solution.sd[frames][:, members], NOISE), limit / 3.0)
            shape = np.broadcast_to(mean_shape(truth.positions[learnt][:, members]), answers.shape)
            rigid = placed(shape, answers, 1.0 / np.square(sd))
            for share, positions in moved.items():
                steps = np.where(own[..., None], share * (rigid - answers), 0.0)
                positions[np.ix_(frames, members)] += steps
            if limit == LIMITS[0] and own.all(axis=1).sum() > 10:
                whole, true = answers[own.all(axis=1)], truth.positions[frames][:, members][own.all(axis=1)]
                best = placed(whole, true, np.ones(whole.shape[:2]))
                rests.append(np.square(best - true).mean() / np.square(whole - true).mean())
        for share, positions in moved.items():
            after = np.square(positions - truth.positions)[filled].mean()
            ratios[pattern.cell["pattern"], limit, share].append(0.5 * np.log(after / before))


def main():
    """Run both halves of the takes and print a line for each cluster, limit and share."""
    warnings.simplefilter("ignore")
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--seeds", type=int, default=4)
    options = parser.parse_args()
    for half, names in (("chosen on", occlusion.CHOSEN), ("reported on", occlusion.REPORTED)):
        ratios, rests = defaultdict(list), []
        for name in names:
            take = labelled(mocapclean.read(Path(options.folder, f"{name}.c3d")))
            take = take.crop(0, min(len(take), occlusion.MOST_FRAMES))
            for pattern in CLUSTERS:
                for seed in range(options.seeds):
                    trial(take, pattern, seed, ratios, rests)
        for (pattern, limit, share), logarithms in sorted(ratios.items()):
            print(f"{half:12} {pattern:9} SD up to {limit:g} mm, share {share:g}: {np.exp(np.mean(logarithms)):.3f}")
        print(f"{half:12} left without the rigid motion of a segment: {100 * np.mean(rests):.0f} % of the square error")


if __name__ == "__main__":
    main()
