"""Thousands of takes through ``mocapclean fill``: rows, memory, and throughput compared with a plain loop.

    python benchmarks/batch.py [folder of captures] [--takes 2000] [--broken 200] [--few 200] [--method linear]

Copies the captures under many names (hard links) into a temporary folder, together with damaged files, and runs

- a few and all of them on two workers: the peak memory of the main process; every take has one correct row;
- the same few takes in a plain loop over ``repair`` in one process, on one worker and on two: seconds of wall time.

Compare seconds only on an idle machine; ratios are within one run.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import hashlib
import json
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

CAPTURES = Path(__file__).resolve().parents[2] / "shared" / "data"
LOOP = """
import sys
from pathlib import Path
from mocapclean.config.loading import resolve
from mocapclean.report import record
from mocapclean.pipeline.repair import repair
source, out = Path(sys.argv[1]), Path(sys.argv[2])
settings = resolve(None, {"method": sys.argv[3]})
with open(sys.argv[4], "w") as report:
    for path in sorted(p for p in source.rglob("*") if p.suffix.lower() in (".c3d", ".bvh", ".amc")):
        output = out / path.relative_to(source)
        output.parent.mkdir(parents=True, exist_ok=True)
        report.writelines(record.text([record.row(repair(path, output, settings))], {}))
"""


def copies(captures: Path, folder: Path, n_takes: int, n_broken: int, largest: int) -> Path:
    """Copy takes under many names, each .amc with its .asf, and damaged files; return the folder."""
    rng = random.Random(2018)
    takes = sorted(p for p in captures.rglob("*") if p.suffix.lower() in (".c3d", ".bvh", ".amc"))
    takes = [path for path in takes if path.stat().st_size <= largest]
    for number in range(n_takes):
        path = takes[number % len(takes)]
        place = folder / f"day {number // 100:02}" / f"{number:04}"
        place.mkdir(parents=True)
        os.link(path, place / path.name) if _linkable(path, folder) else shutil.copy(path, place)
        if path.suffix.lower() == ".amc":
            for skeleton in path.parent.glob("*.asf"):
                if path.stem.startswith(skeleton.stem + "_"):
                    shutil.copy(skeleton, place)
    for number in range(n_broken):
        content = bytearray(takes[number % len(takes)].read_bytes())
        kind = number % 3
        if kind == 0:
            content = content[: rng.randrange(len(content) // 2)]
        elif kind == 1:
            content[:512] = rng.randbytes(512)
        else:
            content = bytearray(rng.randbytes(2000))
        (folder / f"broken {number:03}{takes[number % len(takes)].suffix}").write_bytes(content)
    return folder


def _linkable(path: Path, folder: Path) -> bool:
    return path.stat().st_dev == folder.stat().st_dev


def run(command: list[str]) -> tuple[float, int]:
    """Return the seconds of wall time of a command and the peak memory of its process in bytes."""
    started = perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    peak = 0
    while process.poll() is None:
        try:
            status = Path(f"/proc/{process.pid}/status").read_text()
            peak = max(peak, *(int(line.split()[1]) << 10 for line in status.splitlines() if line.startswith("VmHWM")))
        except (OSError, TypeError):
            pass
        try:
            process.wait(0.2)
        except subprocess.TimeoutExpired:
            continue
    return perf_counter() - started, peak


def fill(source: Path, out: Path, method: str, workers: int) -> tuple[float, int]:
    words = ["fill", source, "--out-dir", out, "--method", method, "--workers", workers, "--quiet"]
    words += ["--timeout", 600, "--report", out.with_suffix(".json")]
    return run([sys.executable, "-m", "mocapclean", *map(str, words)])


def check(source: Path, out: Path, n_takes: int) -> str:
    """Return the totals of a report; fail unless its rows agree with the inputs and outputs."""
    report = json.loads(out.with_suffix(".json").read_text(encoding="utf-8"))
    rows = {take["source"]: take for take in report["takes"]}
    assert len(rows) == len(report["takes"]) == n_takes
    written = set()
    for row in rows.values():
        if row["output"]:
            assert hashlib.sha256(Path(row["output"]).read_bytes()).hexdigest() == row["sha256"]["output"]
            assert hashlib.sha256(Path(row["source"]).read_bytes()).hexdigest() == row["sha256"]["source"]
            written.add(row["output"])
    outputs = {str(path) for path in out.rglob("*") if path.is_file() and ".mocapclean" not in path.parts}
    assert outputs == written
    return ", ".join(f"{name} {count:,}" for name, count in report["totals"].items() if name != "samples")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", nargs="?", type=Path, default=CAPTURES)
    parser.add_argument("--takes", type=int, default=2000)
    parser.add_argument("--broken", type=int, default=200)
    parser.add_argument("--few", type=int, default=200)
    parser.add_argument("--method", default="linear")
    parser.add_argument("--largest", type=int, default=4 << 20, help="leave out captures of more bytes")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        few = copies(options.captures, folder / "few", options.few, 0, options.largest)
        many = copies(options.captures, folder / "many", options.takes, options.broken, options.largest)
        seconds, memory = {}, {}
        loop = [sys.executable, "-c", LOOP, few, folder / "loop", options.method, folder / "loop.json"]
        seconds["loop"], _ = run([str(word) for word in loop])
        for workers in (1, 2):
            seconds[workers], memory["few"] = fill(few, folder / f"few{workers}", options.method, workers)
        print(f"{options.few} takes: {check(few, folder / 'few2', options.few)}")
        print(f"  plain loop {seconds['loop']:.1f} s, 1 worker {seconds[1]:.1f} s, 2 workers {seconds[2]:.1f} s")
        print(f"  1 worker / loop: {seconds['loop'] / seconds[1]:.2f}, 2 workers / 1: {seconds[1] / seconds[2]:.2f}")
        taken, memory["many"] = fill(many, folder / "many2", options.method, 2)
        n_many = options.takes + options.broken
        print(f"{n_many} takes, 2 workers, {taken:.1f} s: {check(many, folder / 'many2', n_many)}")
        print(f"  main process: {memory['few'] >> 20} MB for few, {memory['many'] >> 20} MB for all", end=", ")
        print(f"ratio {memory['many'] / memory['few']:.2f}")


if __name__ == "__main__":
    main()
