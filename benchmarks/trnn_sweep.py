"""The sweep behind the defaults of trnn and tsmc: one parameter at a time around them.

As trnn2_sweep.py, on AMC captures kept apart from the results; writes trnn_sweep.csv beside this file.

    python benchmarks/trnn_sweep.py [folder of captures]
"""

import csv
import sys
from pathlib import Path

from trnn2_sweep import CAPTURES, N_FRAMES, measure, read_take

from mocapclean.solvers import SOLVERS
from mocapclean.take import Take

TAKES = ("02_05", "05_10", "14_04", "61_02", "118_10")
PATTERNS = ("20", "60", "long")
SETTINGS = {
    "linear": {},
    "trnn": {
        "growth": (1.4, 1.1, 1.05, 1.01),
        "penalty": (1e-4, 1e-3),
        "start": ("interpolated",),
        "factors": ("alternating",),
        "dimension": (15, 30, 999),
        "rank": (0, 5, 10),
        "rank_limit": (20,),
        "smoothness": (10.0, 1000.0),
        "sparsity": (30.0, 300.0),
        "polish": (1.0, 5.0),
    },
    "tsmc": {
        "penalty": (0.5, 2.0),
        "memory": (5, 20),
        "tolerance": (1e-4,),
        "order": (1,),
        "smoothness": (10.0, 1000.0),
        "sparsity": (30.0, 300.0),
    },
}


def middle(take: Take) -> Take:
    first = max((len(take.positions) - N_FRAMES) // 2, 0)
    return take.crop(first, first + N_FRAMES)


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else CAPTURES
    truths = {name: middle(read_take(folder / f"amc/{name}.amc")) for name in TAKES}
    columns = ["method", "setting", "value", "take", "pattern", "rmse_mm", "converged", "iterations", "seconds"]
    with Path(__file__).with_suffix(".csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        for method, settings in SETTINGS.items():
            for name, value in [("defaults", ""), *((key, value) for key in settings for value in settings[key])]:
                params = SOLVERS[method].Params(**({} if name == "defaults" else {name: value}))
                for take, truth in truths.items():
                    for pattern in PATTERNS if name == "defaults" else ("60",):
                        row = {"method": method, "setting": name, "value": value, "take": take, "pattern": pattern}
                        writer.writerow(row | measure(method, params, truth, pattern, seed=1))
                        file.flush()


if __name__ == "__main__":
    main()
