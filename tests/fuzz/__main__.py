"""Mutated C3D, BVH, AMC and ASF files and tables through read, detect, fill linear and write.

    python -m tests.fuzz [--inputs 10000] [--first 0] [--workers 1] [--kinds trc,csv,tsv] [--captures ../shared/data]
        [--found fuzz-found]

An input depends on its seed alone: ``--first SEED --inputs 1`` makes a finding again. A finding is: an exception other
than MocapcleanError, a warning of the arithmetic, more than 5 s of processor time, more than 1 GiB of memory, the end
of the process, an output although the take was refused, or an output that cannot be read. Exit code 1 if there is any.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import signal
import sys
from collections import Counter
from pathlib import Path

from tqdm import tqdm

from mocapclean.batch.limits import WorkerLimits
from mocapclean.batch.pool import Stop, run
from tests.fuzz.target import KINDS, Fuzz

ROOT = Path(__file__).resolve().parents[2]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=10000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--kinds", type=lambda text: tuple(text.split(",")), default=KINDS)
    parser.add_argument("--captures", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--found", type=Path, default=Path("fuzz-found"))
    options = parser.parse_args()
    fuzz = Fuzz((ROOT / "sample_data", options.captures), options.found.absolute(), options.kinds)
    counts: Counter[str] = Counter()
    seeds = range(options.first, options.first + options.inputs)
    limits = WorkerLimits(workers=options.workers, timeout=120.0, memory=1 << 30)
    stop = Stop()
    signal.signal(signal.SIGINT, stop)
    for seed, answer in tqdm(run(fuzz, seeds, limits, stop), total=len(seeds), unit="input", disable=None):
        counts["refused" if answer == "refused" else "repaired" if answer == "repaired" else "FOUND"] += 1
        if not isinstance(answer, str):
            print(f"seed {seed}: {answer}", flush=True)
    print(", ".join(f"{count:,} {kind}" for kind, count in sorted(counts.items())))
    return int(counts["FOUND"] > 0)


if __name__ == "__main__":
    sys.exit(main())
