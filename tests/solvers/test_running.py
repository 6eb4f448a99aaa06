"""Every method is run by one function, and a method in the registry is all that the command needs."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import toy_method

import mocapclean
from mocapclean.config.settings import Settings
from mocapclean.errors import SolverError, UsageError
from mocapclean.simulate import hide
from mocapclean.solvers import AUTO_CANDIDATES, SOLVERS
from mocapclean.solvers.running import run_method
from mocapclean.take import Take

TESTS = Path(__file__).resolve().parents[1]
SAMPLES = TESTS.parent / "sample_data"


def wandering(rng: np.random.Generator) -> tuple[Take, np.ndarray]:
    """Markers that keep no distance, and the samples (F, M) to hide."""
    walks = np.cumsum(rng.normal(0, 60, (60, 4, 3)), axis=0)
    missing = np.zeros((60, 4), dtype=bool)
    missing[20:30, 1] = True
    take = Take(positions=walks, trusted=~np.zeros_like(missing), markers=("a", "b", "c", "d"), rate=60.0)
    return take, missing


def test_the_traits_give_the_lists_of_methods():
    assert AUTO_CANDIDATES == Settings().auto.methods == ("kriging", "pca", "pma", "kalman", "spline", "linear")
    checked = [name for name, module in SOLVERS.items() if module.TRAITS.self_checked]
    assert checked == ["kriging", "linear", "spline"]


def test_nothing_to_fill_is_answered_without_a_call(rng, monkeypatch):
    take, _ = wandering(rng)
    for name, module in SOLVERS.items():
        monkeypatch.setattr(module, "solve", None)
        solution = run_method(name, take, module.Params())
        assert solution.reason == "nothing to fill"
        assert not solution.filled.any()
        assert (solution.sd is not None) == module.TRAITS.error_bars


def test_what_a_method_needs_is_asked_for(rng):
    take = hide(*wandering(rng))
    for name, module in SOLVERS.items():
        if module.TRAITS.needs_dictionary:
            with pytest.raises(UsageError, match="needs a trained dictionary"):
                run_method(name, take, module.Params())
        elif module.TRAITS.needs_bones:
            with pytest.raises(SolverError, match=f"{name} must .* give a skeleton"):
                run_method(name, take, module.Params())
        else:
            assert run_method(name, take, module.Params()).filled.any()


def test_only_methods_that_extrapolate_fill_the_ends(rng):
    take, missing = wandering(rng)
    missing[:5, 2] = True
    for name, module in SOLVERS.items():
        if not (module.TRAITS.needs_dictionary or module.TRAITS.needs_bones):
            filled = run_method(name, hide(take, missing), module.Params()).filled
            assert filled[20:30, 1].all(), name
            assert filled[:5, 2].any() <= module.TRAITS.extrapolates, name


def toy(*arguments: object) -> str:
    """The output of the command with the toy method in the registry."""
    command = [sys.executable, str(TESTS / "toy_method.py"), *map(str, arguments)]
    package = str(Path(mocapclean.__file__).resolve().parents[1])
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, env={**os.environ, "PYTHONPATH": package}
    )
    return done.stdout


def test_the_command_has_every_registered_method(tmp_path):
    shown = toy("methods", "toy")
    assert toy_method.REFERENCE in shown
    assert "share" in shown
    assert "a, 1, share of the travel that is followed" in shown
    output = tmp_path / "walk.c3d"
    printed = toy("fill", SAMPLES / "walk.c3d", "-o", output, "--method", "toy", "--set", "share=0.5")
    assert "toy" in printed
    take = mocapclean.detect(mocapclean.read(SAMPLES / "walk.c3d"))
    solution = toy_method.solve(take, toy_method.Params(share=0.5), ~take.trusted)
    np.testing.assert_allclose(mocapclean.read(output).positions, solution.positions, atol=1e-2)
