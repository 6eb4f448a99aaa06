"""Gaps of captures beside those of both generators: how long they are, and how many neighbours are lost together.

    python benchmarks/gap_statistics.py CAPTURES/c3d [seeds]

The natural gaps are those of all C3D files of the folder with at least 12 labelled markers, 200 frames, 1 % of the
samples missing and 10 gaps; files with the same gaps count once. ``occlude`` loses 5 % of the samples, and cameras what
they do not see, in the takes of ``mocapclean bench occlusion``. Each value is the median over takes (and seeds):

missing         share of the samples
10, 50, 90 %    quantiles of the lengths in seconds of gaps inside the take, of takes with at least 5
one frame       share of these gaps
at ends         share of the missing samples that are in gaps at the first or last frame of the take
neighbours      share of the 3 nearest markers that are missing too where a sample is
by chance       the same if the gaps of the neighbours were at other times
touched         share of the markers with a gap

The last column is the distance from the natural gaps: the RMS, over the quantiles of length, of the logarithm to the
base of 2 of the ratio; then the same of neighbours over chance.
"""

import sys
from pathlib import Path

import numpy as np

import mocapclean
from mocapclean.arrays import column_runs
from mocapclean.errors import MocapcleanError
from mocapclean.experiments import occlusion
from mocapclean.experiments.markers import labelled
from mocapclean.report.text import table
from mocapclean.simulate import occlude, occlude_by_cameras

FEWEST_GAPS, LEAST_MISSING, FEWEST_INSIDE, NEAREST = 10, 0.01, 5, 3
QUANTILES = (0.1, 0.5, 0.9)
GENERATORS = {
    "occlude": occlude,
    **{f"{n} cameras": lambda take, rng, n=n: occlude_by_cameras(take, rng, n) for n in (6, 8, 12, 16)},
}
HEADER = (
    *("gaps of", "takes", "missing", "10 %", "50 %", "90 %", "one frame"),
    *("at ends", "neighbours", "by chance", "touched", "lengths off", "together off"),
)


def statistics(take, missing):
    """Return the statistics of the missing samples (F, M) of a take, NaN where there are too few gaps."""
    gaps = list(column_runs(missing))
    seconds = np.array([(b - a) / take.rate for _, a, b in gaps if a > 0 and b < len(missing)])
    enough = len(seconds) >= FEWEST_INSIDE
    quantiles = np.quantile(seconds, QUANTILES) if enough else np.full(len(QUANTILES), np.nan)
    one_frame = np.mean(seconds * take.rate < 1.5) if enough else np.nan
    n_missing = missing.sum()
    if not n_missing:
        return np.array([0.0, *quantiles, one_frame, np.nan, np.nan, np.nan, 0.0])
    at_ends = sum(b - a for _, a, b in gaps if a == 0 or b == len(missing)) / n_missing
    near = occlusion.neighbours(take)[:, 1 : NEAREST + 1]
    together = missing[:, near][missing].mean()
    chance = np.average(missing.mean(axis=0)[near].mean(axis=1), weights=missing.sum(axis=0))
    return np.array(
        [missing.mean(), *quantiles, one_frame, at_ends, together, chance, missing.any(axis=0).mean()], dtype=float
    )


def natural(folder):
    """Yield the takes with natural gaps."""
    seen = set()
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() != ".c3d":
            continue
        try:
            take = labelled(mocapclean.read(path))
        except MocapcleanError:
            continue
        n_frames, n_markers = take.trusted.shape
        missing = ~take.trusted
        key = missing.tobytes()
        if n_frames < occlusion.MIN_FRAMES or n_markers < occlusion.MIN_MARKERS or key in seen:
            continue
        if missing.mean() >= LEAST_MISSING and len(list(column_runs(missing))) >= FEWEST_GAPS:
            seen.add(key)
            print(f"natural: {path.stem}", file=sys.stderr)
            yield take


def line(name, rows, reference):
    """Return a line of the table."""
    with np.errstate(invalid="ignore"):
        values = np.nanmedian(np.array(rows), axis=0)
    off, ratio = "", ""
    if reference is not None:
        off = f"{np.sqrt(np.mean(np.log2(values[1:4] / reference[1:4]) ** 2)):.2f}"
        ratio = f"{abs(np.log2(values[6] / values[7] / (reference[6] / reference[7]))):.2f}"
    share = [f"{100 * v:.1f} %" for v in (values[0], *values[4:])]
    lengths = [f"{v:.3f}" for v in values[1:4]]
    return values, (name, str(len(rows)), share[0], *lengths, *share[1:], off, ratio)


def main(folder, n_seeds):
    """Print the table."""
    rows = [statistics(take, ~take.trusted) for take in natural(folder)]
    reference, first = line("captures", rows, None)
    lines = [first]
    takes = [
        labelled(mocapclean.read(folder / f"{name}.c3d")).crop(0, occlusion.MOST_FRAMES)
        for name in (*occlusion.CHOSEN, *occlusion.REPORTED)
    ]
    for name, generate in GENERATORS.items():
        rows = [
            statistics(take, generate(take, np.random.default_rng(seed)) & take.trusted)
            for take in takes
            for seed in range(n_seeds)
        ]
        lines.append(line(name, rows, reference)[1])
    print("\n".join(table(lines, HEADER)))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1)
