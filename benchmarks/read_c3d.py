"""Time and memory of reading, patching and verifying C3D files.

Reading is compared, in the same run, with a plain read of the file's bytes and numpy's conversion of its points to
float64; writing is compared with a plain copy. Peak memory is compared with the point block in the file.
Run: python benchmarks/read_c3d.py [folder of captures]
"""

import dataclasses
import shutil
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np

from mocapclean.formats import c3d
from mocapclean.take import ReadOptions

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from c3d_builder import C3D, ENCODING_IDS, ENCODINGS, walk  # noqa: E402

REPEATS = 5


def best(action: Callable[[], object]) -> float:
    """The shortest of some runs, in seconds."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def peak(action: Callable[[], object]) -> int:
    """The most bytes allocated at once."""
    tracemalloc.start()
    action()
    highest = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return highest


def plain_read(path: Path, document: c3d.C3dDocument) -> np.ndarray:
    """The points of a file by the shortest way that numpy offers; for DEC without its conversion."""
    order = document.words.raw.byteorder.replace("=", "<").replace("|", "<")
    kind = f"{order}f4" if document.words.is_float else f"{order}i2"
    numbers = np.frombuffer(path.read_bytes(), kind, document.n_frames * document.n_words, document.data_start)
    points = numbers.reshape(document.n_frames, document.n_words)[:, : 4 * document.n_points]
    return points.reshape(document.n_frames, document.n_points, 4)[..., :3].astype(np.float64)


def report(name: str, path: Path, out: Path) -> None:
    take = c3d.read(path, ReadOptions())
    document = take.origin.document  # type: ignore[union-attr]
    plain, own = best(lambda: plain_read(path, document)), best(lambda: c3d.read(path, ReadOptions()))
    block = document.n_frames * document.n_points * 4 * document.words.raw.itemsize
    memory = peak(lambda: c3d.read(path, ReadOptions())) / block
    filled = np.zeros(take.trusted.shape, dtype=bool)
    filled[len(filled) // 4 : len(filled) // 2, ::7] = True
    positions = np.where(filled[..., None], 1.0, take.positions)
    gap = dataclasses.replace(take, positions=positions, filled=filled)
    copy, patch = best(lambda: shutil.copyfile(path, out)), best(lambda: c3d.write(gap, out))
    written = c3d.write(gap, out)
    proof = best(lambda: c3d.prove(written, out))
    print(
        f"{name[:44]:44} {path.stat().st_size / 1e6:7.1f} MB  read {own * 1e3:7.1f} ms, {own / plain:5.2f} x plain; "
        f"peak {memory:5.2f} x points; copy {copy * 1e3:6.1f}, write {patch * 1e3:6.1f}, prove {proof * 1e3:6.1f} ms"
    )


def main() -> None:
    captures = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT.parent / "shared" / "data" / "c3d"
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder, "big.c3d"), Path(folder, "out.c3d")
        for name, (machine, is_float) in zip(ENCODING_IDS, ENCODINGS, strict=True):
            path.write_bytes(C3D(walk(60_000, 60), machine, is_float, analog=np.ones((60_000, 24))).build())
            report(f"60000 x 60, {name}", path, out)
        path.write_bytes(C3D(walk(60_000, 60), labels=[f"*{i}" if i % 3 else f"M{i}" for i in range(60)]).build())
        report("60000 x 60, every third a marker", path, out)
        for capture in sorted(captures.glob("*.c3d"), key=lambda p: -p.stat().st_size)[:12]:
            report(capture.stem, capture, out)


if __name__ == "__main__":
    main()
