"""A few mutated samples, and faults of the program that they must detect."""

from pathlib import Path

import pytest

from tests.fuzz import target
from tests.fuzz.target import Fuzz, HangError

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"


def test_mutated_samples_are_refused_or_repaired(tmp_path, monkeypatch):
    monkeypatch.setattr(target, "SECONDS", 20.0)  # the other tests run beside it
    fuzz = Fuzz((SAMPLES,), tmp_path / "found")
    answers = [fuzz(seed) for seed in range(40)]
    assert set(answers) == {"refused", "repaired"}
    assert not (tmp_path / "found").exists()


def test_an_input_is_made_by_its_seed_alone(tmp_path):
    fuzz = Fuzz((SAMPLES,), tmp_path / "found")
    made = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        made.append([fuzz.input(seed, tmp_path / name).read_bytes() for seed in (3, 4, 5)])
    assert made[0] == made[1]
    assert len(set(made[0])) == 3


def crash(*arguments):
    raise KeyError("x")


def hang(*arguments):
    while True:
        pass


def devour(*arguments):
    raise MemoryError


@pytest.mark.parametrize(("fault", "error"), [(crash, KeyError), (hang, HangError), (devour, MemoryError)])
def test_a_fault_is_found_and_its_input_kept(tmp_path, monkeypatch, fault, error):
    monkeypatch.setattr(target, "repair", fault)
    monkeypatch.setattr(target, "SECONDS", 0.2)
    with pytest.raises(error):
        Fuzz((SAMPLES,), tmp_path / "found")(7)
    assert {path.stem for path in (tmp_path / "found").iterdir()} == {"7"}
