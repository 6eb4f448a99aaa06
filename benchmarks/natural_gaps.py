"""Print how the default method's fill of natural gaps agrees with what is measured beside them.

    python benchmarks/natural_gaps.py FOLDER [--captures 20]

The captures are the C3D files of the folder with the most gaps, at least 100 frames and 10 labelled markers. For each:

measured      RMS deviation, mm, of rigid pairs from their mean distance where both are measured (SD up to 3 mm)
beside        the same where both are measured, within 10 frames of a sample of them that is filled
filled        the same where one of them is filled
good          gaps graded good beside a measured rigid partner
contradicted  those whose deviation is above three times their expected error, and the SD of the pair
alone         those of them beside which no measured sample of the pair is two thirds as far off
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
NEAR = 10  # frames from a filled sample up to which a measured one is beside it


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
    """Return the gaps, three RMS deviations (mm), the good, contradicted and lone gaps, and markers that step far."""
    solution = run_method(DEFAULT_METHOD, take, SOLVERS[DEFAULT_METHOD].Params())
    positions = np.where(solution.filled[..., None], solution.positions, take.positions)
    present = take.trusted | solution.filled
    mean, spread = mean_distances(take.positions, take.trusted, FRAMES)
    pairs = np.argwhere(np.triu(spread < RIGID, 1))
    squares, good, contradicted, alone = [], set(), set(), set()
    for a, b in pairs:
        deviation = np.linalg.norm(positions[:, a] - positions[:, b], axis=1) - mean[a, b]
        measured = take.trusted[:, a] & take.trusted[:, b]
        filled = present[:, a] & present[:, b] & ~measured
        if filled.any():
            beside = measured & (np.convolve(filled, np.ones(2 * NEAR + 1), "same") > 0.5)
            squares.append(
                [np.square(deviation[of]).mean() if of.any() else np.nan for of in (measured, beside, filled)]
            )
        for marker, partner in ((a, b), (b, a)):
            for _, start, stop in column_runs(solution.filled[:, [marker]]):
                beside = take.trusted[start:stop, partner]
                expected = metrics.expected_error(solution.sd[start:stop, marker])
                if beside.any() and expected <= Grades().good:
                    good.add((marker, start))
                    off = np.sqrt(np.square(deviation[start:stop][beside]).mean())
                    if off > 3.0 * max(expected, spread[a, b]):
                        contradicted.add((marker, start))
                        sides = [at for at in (start - 1, stop) if 0 <= at < len(measured) and measured[at]]
                        if np.abs(deviation[sides]).max(initial=0.0) < off / 1.5:
                            alone.add((marker, start))
    step = np.linalg.norm(np.diff(positions, axis=0), axis=2)
    own = np.where(take.trusted[1:] & take.trusted[:-1], step, 0.0).max(axis=0)
    beside_fill = (solution.filled[1:] | solution.filled[:-1]) & present[1:] & present[:-1]
    far = int((np.where(beside_fill, step, 0.0).max(axis=0) > 1.5 * np.maximum(own, 1.0)).sum())
    gaps = sum(1 for _ in column_runs(~take.trusted))
    deviations = np.sqrt(np.nanmean(squares or [[np.nan] * 3], axis=0))
    return gaps, *deviations, len(good), len(contradicted), len(alone), far


def main():
    """Run the captures and print a line for each."""
    warnings.simplefilter("ignore")
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--captures", type=int, default=20)
    options = parser.parse_args()
    print(f"{'capture':46} gaps  measured  beside  filled  ratio  good  contradicted  alone  far")
    rows = []
    for name, take in captures(options.folder, options.captures):
        rows.append(agreement(take))
        gaps, measured, beside, filled, good, contradicted, alone, far = rows[-1]
        print(
            f"{name[:45]:46} {gaps:4} {measured:9.2f} {beside:7.2f} {filled:7.2f} {filled / measured:6.2f} {good:5} "
            f"{contradicted:13} {alone:6} {far:4}",
            flush=True,
        )
    table = np.array(rows)
    _, measured, beside, filled, good, contradicted, alone, far = table.T
    print(
        f"median of filled over measured {np.nanmedian(filled / measured):.2f}, over beside "
        f"{np.nanmedian(filled / beside):.2f}; {int(contradicted.sum())} of {int(good.sum())} good gaps contradicted, "
        f"{int(alone.sum())} of them alone; {int(far.sum())} markers step too far"
    )


if __name__ == "__main__":
    main()
