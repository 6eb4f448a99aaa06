"""How many takes pass each preset of ``mocapclean check``, on both halves of a folder of captures.

    python benchmarks/presets.py FOLDER

Takes of each format, sorted by name, belong in turn to the halves "chosen on" and "reported on". Prints two tables in
Markdown: takes that pass, and how many exceed each limit ("default" has no preset); and percentiles of the measures
of the first half, of the takes that can be read.
"""

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

from mocapclean import formats
from mocapclean.config.loading import resolve
from mocapclean.config.presets import PRESETS
from mocapclean.experiments.markers import HALF_NAMES
from mocapclean.pipeline.check import CheckTake

PERCENTILES = (50, 67, 75, 80, 90, 95, 100)
"""Shares of the takes, %, in the second table."""


def exceeded(verdict, limits):
    """Return the limits that a take exceeds: those of the default, and those of a preset."""
    own = {breach.limit for breach in verdict.breaches}
    return own | {name for name, limit in limits.items() if verdict.measures.get(name, 0.0) > limit}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    by_format = defaultdict(list)
    for path in sorted(folder.rglob("*"), key=lambda path: path.name):
        if path.suffix.lower() in formats.suffixes():
            by_format[path.suffix.lower()[1:].upper()].append(path)
    check = CheckTake(resolve(None, {}))
    checked = {kind: [check(path) for path in paths] for kind, paths in sorted(by_format.items())}
    print_passes(checked)
    print_percentiles(checked)


def print_passes(checked):
    """Print how many takes of each format and half pass, for each preset."""
    print("| format | half | limits | takes that pass | takes that exceed a limit |")
    print("|---|---|---|---|---|")
    for kind, verdicts in checked.items():
        for k, half in enumerate(HALF_NAMES):
            for name, limits in {"default": {}, **PRESETS}.items():
                found = [exceeded(verdict, limits) for verdict in verdicts[k::2]]
                counts = Counter(limit for each in found for limit in each)
                told = ", ".join(f"{limit} {number}" for limit, number in counts.most_common()) or "none"
                print(f"| {kind} | {half} | {name} | {sum(not each for each in found)} of {len(found)} | {told} |")


def print_percentiles(checked):
    """Print percentiles of each measure that a preset limits, on the first half."""
    print(f"\n| format | measure | {' | '.join(f'{share} %' for share in PERCENTILES)} |")
    print("|---|---|" + "---|" * len(PERCENTILES))
    for kind, verdicts in checked.items():
        for name in next(iter(PRESETS.values())):
            values = [verdict.measures[name] for verdict in verdicts[::2] if verdict.measures]
            print(f"| {kind} | {name} | {' | '.join(f'{value:.3g}' for value in np.percentile(values, PERCENTILES))} |")


if __name__ == "__main__":
    main()
