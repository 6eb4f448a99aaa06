"""Shared fixtures: the real captures, when they are at hand, and a seeded random generator."""

import os
import shutil
from pathlib import Path

# One BLAS thread for each worker, as in the command; it must be said before NumPy is loaded.
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

import numpy as np  # noqa: E402
import pytest  # noqa: E402

from mocapclean.formats import bvh  # noqa: E402
from mocapclean.simulate import perform  # noqa: E402
from mocapclean.take.posed import posed_take  # noqa: E402

SAMPLES = Path(__file__).resolve().parents[1] / "sample_data"
CAPTURES = Path(__file__).resolve().parents[2] / "shared" / "data"


def capture_files(kind: str) -> list[Path]:
    """All real captures of one kind (c3d, bvh, amc), sorted; empty where none are at hand."""
    return sorted(p for p in (CAPTURES / kind).glob("*") if p.suffix.lower() == f".{kind}")


@pytest.fixture(scope="session")
def captures() -> Path:
    """The folder of real captures."""
    if not CAPTURES.is_dir():
        pytest.skip("the real captures (../shared/data) are not at hand")
    return CAPTURES


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator that gives the same numbers in every run."""
    return np.random.default_rng(20181)


@pytest.fixture
def folder(tmp_path):
    """A copy of the samples that a test may write beside."""
    shutil.copytree(SAMPLES, tmp_path / "takes")
    return tmp_path / "takes"


@pytest.fixture(scope="module")
def skeletons(tmp_path_factory):
    """A folder with a take of a skeleton, four seconds long."""
    folder = tmp_path_factory.mktemp("skeletons")
    walk = perform("walk", 4.0, 60.0, 0)
    bvh.create(posed_take(walk.bvh, walk.bvh_poses, 60.0), folder / "7_01.bvh")
    return folder
