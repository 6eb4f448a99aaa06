"""Takes that are repaired in milliseconds, and what must hold of a run whatever happened in it."""

import hashlib
import json
from pathlib import Path

import c3d_builder
import jsonschema
import numpy as np

import mocapclean

SCHEMA = json.loads((Path(__file__).parents[1] / "docs" / "report.schema.json").read_text(encoding="utf-8"))


def small(seed: int = 7, n_frames: int = 40, n_points: int = 5) -> bytes:
    """A C3D of markers that move along circles; M2 is missing for six frames in the middle."""
    points = np.full((n_frames, n_points, 4), 3.0)
    turn = np.arange(n_frames) / 20
    points[:, :, 0] = np.round(300 * np.cos(turn))[:, None] + 100 * np.arange(n_points) + seed
    points[:, :, 1] = np.round(300 * np.sin(turn))[:, None] - 70 * np.arange(n_points)
    points[:, :, 2] = np.arange(n_frames)[:, None] + 900
    points[n_frames // 2 : n_frames // 2 + 6, 1, 3] = -1
    return c3d_builder.C3D(points, units="mm").build()


def store(folder: Path, *names: str) -> Path:
    """A folder of small takes, each another one."""
    for seed, name in enumerate(names):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(small(seed))
    return folder


def hashes(folder: Path) -> dict[str, str]:
    """The hash of every file below a folder, by its path."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def rows_of(report: Path) -> dict[str, dict]:
    """The rows of a valid report by the path of their input; each take has just one."""
    content = json.loads(report.read_text(encoding="utf-8"))
    jsonschema.validate(content, SCHEMA)
    takes = content["takes"]
    rows = {take["source"]: take for take in takes}
    assert len(rows) == len(takes)
    return rows


def assert_true(rows: dict[str, dict], out_dir: Path) -> None:
    """Every row says what is there, and nothing is there that no row tells of."""
    told = set()
    for source, row in rows.items():
        if row["status"] in ("repaired", "unchanged"):
            output = Path(row["output"])
            content = output.read_bytes()
            assert hashlib.sha256(content).hexdigest() == row["sha256"]["output"]
            assert hashlib.sha256(Path(source).read_bytes()).hexdigest() == row["sha256"]["source"]
            assert mocapclean.read(output).trusted.sum() >= mocapclean.read(source).trusted.sum()
            told.add(output.absolute())
        else:
            assert row["status"] in ("failed", "skipped")
            assert row["error"]
            assert row["output"] is None
    there = {path for path in out_dir.absolute().rglob("*") if path.is_file() and ".mocapclean" not in path.parts}
    assert {path for path in there if not path.name.endswith(".report.json")} == told
