"""The shipped samples are what the package's own generator makes."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import mocapclean
from mocapclean.cli import cli

SAMPLES = Path(__file__).resolve().parents[1] / "sample_data"
TAKES = sorted(path.name for path in SAMPLES.iterdir() if path.suffix != ".asf")


@pytest.fixture(scope="module")
def remade(tmp_path_factory):
    folder = tmp_path_factory.mktemp("remade")
    result = CliRunner().invoke(cli, ["simulate", "--out-dir", str(folder), "--motion", "walk", "--seconds", "4"])
    assert result.exit_code == 0, result.stderr
    return folder


def test_the_same_files_are_there(remade):
    assert {path.name for path in remade.iterdir()} == {path.name for path in SAMPLES.iterdir()}


@pytest.mark.parametrize("name", TAKES)
def test_the_same_takes_are_in_them(remade, name):
    shipped, made = mocapclean.read(SAMPLES / name), mocapclean.read(remade / name)
    assert (shipped.markers, shipped.rate) == (made.markers, made.rate)
    np.testing.assert_array_equal(shipped.trusted, made.trusted)
    np.testing.assert_allclose(shipped.positions[shipped.trusted], made.positions[made.trusted], atol=0.01)


@pytest.mark.parametrize("name", [name for name in TAKES if "truth" not in name])
def test_a_broken_take_agrees_with_its_truth_where_it_is_trusted(name):
    stem, suffix = name.split(".")
    broken, truth = mocapclean.read(SAMPLES / name), mocapclean.read(SAMPLES / f"{stem}_truth.{suffix}")
    assert truth.trusted.all()
    assert 0 < (~broken.trusted).mean() < 0.3
    seen = broken.as_markers().trusted
    np.testing.assert_array_equal(broken.positions[seen], truth.positions[seen])
