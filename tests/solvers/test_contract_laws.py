"""The laws of methods find what breaks them: for each law a toy method with one fault, which it names."""

from types import SimpleNamespace
from typing import Annotated

import numpy as np
import pytest
import toy_method

from mocapclean.parameters import About, parameters
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.contract import LAWS, BrokenLaw, Subject, try_laws
from mocapclean.solvers.method import Traits
from mocapclean.take import Solution


@parameters
class Undocumented:
    share: float = 1.0


@parameters
class Denoising:
    denoise: Annotated[bool, About(symbol="d", text="correct complete takes")] = True


def toy(take, fillable):
    return toy_method.solve(take, toy_method.Params(), fillable).positions


def method(answer, params=toy_method.Params, traits=toy_method.TRAITS):
    """A method that gives the positions of ``answer(take, positions)``, or the Solution that this returns."""

    def solve(take, given, fillable):
        found = answer(take, toy(take, fillable))
        return found if isinstance(found, Solution) else Solution(positions=found, filled=fillable)

    return SimpleNamespace(__doc__="A toy.", REFERENCE="A toy.", TRAITS=traits, Params=params, solve=solve)


def restless(take, positions):
    return positions + np.random.rand()


FAULTS = {
    "documented": method(lambda take, positions: positions, Undocumented),
    "shapes": method(lambda take, positions: Solution(positions=positions, filled=~take.trusted, reason="")),
    "fills": method(lambda take, positions: Solution(positions=positions, filled=np.zeros_like(take.trusted))),
    "complete": method(
        lambda take, positions: Solution(positions=positions, filled=np.ones_like(take.trusted)),
        Denoising,
        Traits(cleans_complete_takes=True),
    ),
    "unread": method(lambda take, positions: positions + take.positions.mean()),
    "repeatable": method(restless),
    "cap": method(lambda take, positions: Solution(positions=positions, filled=~take.trusted, iterations=5)),
    "order": method(lambda take, positions: positions + np.arange(len(take.markers))[:, None]),
    "moves": method(lambda take, positions: 0.9 * positions),
    "sane": method(lambda take, positions: positions + (1e9 if len(take) == 2 else 0.0)),
    "turns": method(lambda take, positions: positions + np.array([1.0, 0.0, 0.0])),
    "scales": method(lambda take, positions: positions + 1.0),
    "better": method(lambda take, positions: positions + 1000.0),
}


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_a_method_with_a_fault_breaks_its_law(monkeypatch, law):
    monkeypatch.setitem(SOLVERS, "faulty", FAULTS[law.name])
    with pytest.raises(BrokenLaw) as broken:
        law.holds(Subject("faulty", FAULTS[law.name]))
    assert str(broken.value)


def test_an_error_in_a_method_breaks_laws_and_ends_nothing(monkeypatch):
    def fails(take, positions):
        raise IndexError("no such marker")

    monkeypatch.setitem(SOLVERS, "faulty", method(fails))
    results = try_laws(Subject("faulty", SOLVERS["faulty"]))
    assert [*results] == [*LAWS]
    assert {law.name: reason for law, reason in results.items()}["shapes"] == "it raises IndexError: no such marker"
