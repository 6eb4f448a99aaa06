"""Hide 10 random joints in every block of 60 frames of a take, and repair it with the installed command.

    python benchmarks/block_loss.py TAKE [TAKE ...] [--method trnn2] [--length 60] [--out 10] [--seed 0]

The spans are written to a CSV for ``--gaps``, and the take is its own ``--reference``. Prints the command's own report.
The repaired file is written to a temporary folder.
"""

import argparse
import csv
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import mocapclean
from mocapclean.arrays import column_runs
from mocapclean.simulate import block_loss


def write_spans(path: Path, length: int, out: int, seed: int, spans: Path) -> None:
    """Write the spans of a block loss of a take as CSV."""
    take = mocapclean.read(path)
    hidden = block_loss(*take.trusted.shape, length, out, np.random.default_rng(seed))
    with spans.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["marker", "first", "last"])
        for marker, start, stop in column_runs(hidden):
            rows.writerow([take.markers[marker], *take.numbers(start, stop)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("takes", nargs="+", type=Path)
    parser.add_argument("--method", default="trnn2")
    parser.add_argument("--length", type=int, default=60)
    parser.add_argument("--out", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    command = shutil.which("mocapclean", path=str(Path(sys.executable).parent)) or "mocapclean"
    with tempfile.TemporaryDirectory() as folder:
        for take in given.takes:
            spans = Path(folder) / "spans.csv"
            write_spans(take, given.length, given.out, given.seed, spans)
            options = ["--method", given.method, "--gaps", spans, "--no-detect", "--reference", take]
            subprocess.run(
                [command, "fill", take, *options, "--out-dir", folder, "--no-report", "--overwrite"], check=False
            )


if __name__ == "__main__":
    main()
