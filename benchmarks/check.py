"""Time of ``mocapclean check``, compared with a plain loop that reads the takes and runs the trust rules.

    python benchmarks/check.py FOLDER [--workers 1]

Prints the wall time of both and their ratio; use an idle machine. Both include takes that cannot be read.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

LOOP = """
import sys
from pathlib import Path
import mocapclean
from mocapclean.errors import MocapcleanError
from mocapclean.detection import detect
for path in sorted(p for p in Path(sys.argv[1]).rglob("*") if p.suffix.lower() in (".c3d", ".bvh", ".amc")):
    try:
        detect(mocapclean.read(path))
    except MocapcleanError:
        pass
"""


def spent(command):
    """Return the seconds of wall time of a command; its output is discarded."""
    begin = perf_counter()
    subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
    return perf_counter() - begin


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    loop = spent([sys.executable, "-W", "ignore", "-c", LOOP, str(given.folder)])
    with tempfile.TemporaryDirectory() as place:
        check = [sys.executable, "-m", "mocapclean", "check", str(given.folder), "--workers", str(given.workers)]
        checked = spent([*check, "--report", f"{place}/check.json"])
    print(f"reading and detection {loop:.1f} s, check {checked:.1f} s: {checked / loop:.2f} times")


if __name__ == "__main__":
    main()
