"""Print how the default method's fill of natural gaps agrees with what is measured beside them.

    python benchmarks/natural_gaps.py FOLDER [--captures 20]

The captures are the C3D files of the folder with the most gaps, at least 100 frames and 10 labelled markers. For each:

measured      RMS deviation, mm, of rigid pairs from their mean distance where both are measured (SD up to 3 mm)
filled        the same where one of them is filled
good          gaps graded good beside a measured rigid partner
contradicted  those whose deviation is above three times their expected error, and the SD of the pair
far           markers with a step beside a filled sample above 1.5 times their largest measured step
"""

import argparse
import warnings
from pathlib import Path

import numpy as np

import mocapclean
from mocapclean.arrays import column_runs
from mocapclean.config.settings import DEFAULT_METHOD, Grades
from mocapclean.errors import MocapcleanError
from mocapclean.evaluation import metrics
from mocapclean.experiments.markers import labelled
from mocapclean.geometry.distances import mean_distances
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method

MOST_MISSING = 0.75  # share of the samples of a capture that is run
RIGID = 3.0  # mm, SD of the distance of a rigid pair
FRAMES = 600  # most frames over which distances are measured


def captures(folder, most):
    """Yield (name, take) of the captures with the most gaps among those with at least 100 frames and 10 markers."""
    found = []
    for path in sorted(Path(folder).glob("*.c3d")):
        try:
            take = labelled(mocapclean.read(path))
        except MocapcleanError:
            continue
        if len(take.trusted) >= 100 and take.trusted.shape[1] >= 10 and (~take.trusted).mean() <= MOST_MISSING:
            found.append((sum(1 for _ in column_runs(~take.trusted)), path.stem, take))
    for _, name, take in sorted(found, key=lambda each: -each[0])[:most]:
        yield name, take


def agreement(take):
    """Return the gaps, both RMS deviations (mm), gaps graded good, contradicted ones, and markers that step too far."""
    solution = run_method(DEFAULT_METHOD, take, SOLVERS[DEFAULT_METHOD].Params())
    positions = np.where(solution.filled[..., None], solution.positions, take.positions)
    present = take.trusted | solution.filled
    mean, spread = mean_distances(take.positions, take.trusted, FRAMES)
    pairs = np.argwhere(np.triu(spread < RIGID, 1))
    squares, good, contradicted = [], set(), set()
    for a, b in pairs:
        deviation = np.linalg.norm(positions[:, a] - positions[:, b], axis=1) - mean[a, b]
        measured = take.trusted[:, a] & take.trusted[:, b]
        filled = present[:, a] & present[:, b] & ~measured
        if filled.any():
            squares.append([np.square(deviation[measured]).mean(), np.square(deviation[filled]).mean()])
        for marker, partner in ((a, b), (b, a)):
            for _, start, stop in column_runs(solution.filled[:, [marker]]):
                beside = take.trusted[start:stop, partner]
                expected = metrics.expected_error(solution.sd[start:stop, marker])
                if beside.any() and expected <= Grades().good:
                    good.add((marker, start))
                    off = np.sqrt(np.square(deviation[start:stop][beside]).mean())
                    if off > 3.0 * max(expected, spread[a, b]):
                        contradicted.add((marker, start))
    step = np.linalg.norm(np.diff(positions, axis=0), axis=2)
    own = np.where(take.trusted[1:] & take.trusted[:-1], step, 0.0).max(axis=0)
    beside_fill = (solution.filled[1:] | solution.filled[:-1]) & present[1:] & present[:-1]
    far = int((np.where(beside_fill, step, 0.0).max(axis=0) > 1.5 * np.maximum(own, 1.0)).sum())
    gaps = sum(1 for _ in column_runs(~take.trusted))
    return gaps, *np.sqrt(np.mean(squares or [[np.nan] * 2], axis=0)), len(good), len(contradicted), far


def main():
    """Run the captures and print a line for each."""
    warnings.simplefilter("ignore")
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--captures", type=int, default=20)
    options = parser.parse_args()
    print(f"{'capture':46} gaps  measured  filled  ratio  good  contradicted  far")
    rows = []
    for name, take in captures(options.folder, options.captures):
        rows.append(agreement(take))
        gaps, measured, filled, good, contradicted, far = rows[-1]
        print(
            f"{name[:45]:46} {gaps:4} {measured:9.2f} {filled:7.2f} {filled / measured:6.2f} {good:5} {contradicted:13}"
            f" {far:4}",
            flush=True,
        )
    table = np.array(rows)
    print(
        f"median ratio {np.nanmedian(table[:, 2] / table[:, 1]):.2f}, {int(table[:, 4].sum())} of "
        f"{int(table[:, 3].sum())} good gaps contradicted, {int(table[:, 5].sum())} markers step too far"
    )


if __name__ == "__main__":
    main()
