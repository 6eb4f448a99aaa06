"""Time of ``mocapclean --version`` compared with ``python -c pass``: medians of alternating runs.

python benchmarks/startup.py
"""

import shutil
import statistics
import subprocess
import sys
from pathlib import Path
from time import perf_counter

RUNS = 30


def seconds(command: list[str]) -> float:
    started = perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return perf_counter() - started


def main() -> None:
    installed = shutil.which("mocapclean", path=str(Path(sys.executable).parent)) or "mocapclean"
    pairs = [(seconds([sys.executable, "-c", "pass"]), seconds([installed, "--version"])) for _ in range(RUNS)]
    bare, version = (statistics.median(column) for column in zip(*pairs, strict=True))
    ratio = statistics.median(b / a for a, b in pairs)
    print(f"python -c pass {1000 * bare:.0f} ms, mocapclean --version {1000 * version:.0f} ms, ratio {ratio:.2f}")


if __name__ == "__main__":
    main()
