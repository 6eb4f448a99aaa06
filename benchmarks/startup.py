"""Processor time of the commands, compared with ``python -c "import numpy, click"``: medians of alternating runs.

    python benchmarks/startup.py [--runs 15]

Processor time, because a busy machine stretches wall time. ``mocapclean --version`` loads no library at all.
"""

import argparse
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import mocapclean

SAMPLE = Path(__file__).resolve().parents[1] / "sample_data" / "walk.c3d"
BARE = [sys.executable, "-c", "import numpy, click"]
COMMANDS = ("fill", "inspect", "check", "methods", "train", "simulate", "bench")


def spent(command: list[str]) -> float:
    """Return the seconds of processor time of a command; its output is discarded."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def small_take(folder: Path) -> Path:
    """Write a C3D file of five markers and 300 frames."""
    path = folder / "small.c3d"
    mocapclean.write(mocapclean.read(SAMPLE).crop(0, 300).select(list(range(5))), path)
    return path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=15)
    runs = parser.parse_args().runs
    installed = shutil.which("mocapclean", path=str(Path(sys.executable).parent)) or "mocapclean"
    with tempfile.TemporaryDirectory() as folder:
        small, filled = small_take(Path(folder)), Path(folder) / "filled.c3d"
        fill = ["fill", str(small), "-o", str(filled), "--overwrite", "--method", "linear", "--no-self-check"]
        lines = [
            ["--version"],
            ["--help"],
            *([name, "--help"] for name in COMMANDS),
            ["methods"],
            ["inspect", str(small)],
            ["check", str(small)],
            fill,
        ]
        ratios: list[list[float]] = [[] for _ in lines]
        for _ in range(runs):
            for line, found in zip(lines, ratios, strict=True):
                bare = spent(BARE)
                found.append(spent([installed, *line]) / bare)
    for line, found in zip(lines, ratios, strict=True):
        shown = " ".join(line).replace(f"{folder}/", "")
        print(f"{statistics.median(found):5.2f}  mocapclean {shown}")


if __name__ == "__main__":
    main()
