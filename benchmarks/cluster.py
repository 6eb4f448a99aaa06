"""Takes through ``mocapclean fill`` on a Dask cluster of this machine, compared with local workers.

    python benchmarks/cluster.py [folder of captures] [--takes 200] [--broken 20] [--largest 1500000]

A scheduler and two workers run as separate processes. In a second run one of the workers is killed half-way. The three
runs must write the same bytes, and reports with the same rows except for seconds and paths of outputs. Needs the extra
``cluster``.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import hashlib
import json
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter, sleep

from batch import CAPTURES, copies


def dask(folder, *words):
    """Start a scheduler or a worker in a process group of its own."""
    command = [sys.executable, "-m", "distributed.cli.dask_" + words[0], *map(str, words[1:])]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(command, cwd=folder, stdout=quiet, stderr=quiet, start_new_session=True)


def fill(source, out, *words):
    """Start a run of ``mocapclean fill``."""
    command = ["fill", source, "--out-dir", out, "--method", "linear", "--quiet", "--report", out.with_suffix(".json")]
    return subprocess.Popen([sys.executable, "-m", "mocapclean", *map(str, [*command, *words])], stdout=sys.stderr)


def outputs(out):
    """Return the SHA-256 of every output by name."""
    files = (path for path in out.rglob("*") if path.is_file() and ".mocapclean" not in path.parts)
    return {str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def rows(out):
    """Return the rows of a report by source, without seconds and with relative paths."""
    report = json.loads(out.with_suffix(".json").read_text(encoding="utf-8"))
    assert len({take["source"] for take in report["takes"]}) == len(report["takes"])
    by_source = {take.pop("source"): take for take in report["takes"]}
    for take in by_source.values():
        take.pop("seconds", None)
        take["output"] = take["output"] and os.path.relpath(take["output"], out)
    return by_source


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", nargs="?", type=Path, default=CAPTURES)
    parser.add_argument("--takes", type=int, default=200)
    parser.add_argument("--broken", type=int, default=20)
    parser.add_argument("--largest", type=int, default=1500000, help="leave out captures of more bytes")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        source = copies(given.captures, folder / "captures", given.takes, given.broken, given.largest)
        fill(source, folder / "local", "--workers", "2").wait()
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        words = ("--host", "127.0.0.1", "--port", address.rpartition(":")[2], "--no-dashboard")
        cluster = [dask(folder, "scheduler", *words)]
        for name in ("one", "two"):
            words = ("--nthreads", 1, "--nworkers", 1, "--no-dashboard", "--local-directory", folder / name)
            cluster.append(dask(folder, "worker", address, *words))
        try:
            for name, kill in (("whole", False), ("killed", True)):
                out, begin = folder / name, perf_counter()
                process = fill(source, out, "--scheduler", address)
                while kill and len(outputs(out)) < given.takes // 4:
                    sleep(0.1)
                if kill:
                    os.killpg(cluster[-1].pid, signal.SIGKILL)
                process.wait()
                same = outputs(out) == outputs(folder / "local"), rows(out) == rows(folder / "local")
                print(
                    f"{name}: {len(rows(out))} rows, {len(outputs(out))} outputs, {perf_counter() - begin:.0f} s;",
                    end=" ",
                )
                print(f"outputs as on local workers: {same[0]}, rows: {same[1]}", flush=True)
        finally:
            for process in cluster:
                try:
                    os.killpg(process.pid, signal.SIGKILL)
                except ProcessLookupError:
                    continue


if __name__ == "__main__":
    main()
