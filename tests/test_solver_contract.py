"""The laws that every gap-filling method keeps; each exception stands in one table with its reason.

A toy method, which only the tests register, keeps them too: a new method is one module and one line of the registry.
"""

import numpy as np
import pytest
import toy_method

from mocapclean.parameters import annotations
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.contract import LAWS, BrokenLaw, Subject, check_sane, takes

EXCEPTIONS = {
    ("linear", "better"): "it is the yardstick",
    ("spline", "better"): "no curve through the marker itself can tell what it did over a whole stride",
    ("spline", "turns"): "the slope limiter works on each coordinate",
    ("trnn2", "turns"): "the magnitudes of the first difference are summed coordinate by coordinate",
    ("trnn", "turns"): "the magnitudes of the sparse noise are summed coordinate by coordinate",
    ("tsmc", "turns"): "the magnitudes of the sparse noise are summed coordinate by coordinate",
    ("bolero", "scales"): "markers are a rigid pair when their distance stays within so many millimetres",
    ("scsvt", "scales"): "markers are a rigid pair when their distance stays within so many millimetres",
}
METHODS = [*SOLVERS, "toy"]
STEADY = {  # where a long way through non-convex or extrapolated iterates magnifies rounding, a way that does not
    "tsmc": {"memory": 0, "max_iterations": 400},
    "trnn": {"growth": 1.4},
}
CASES = [(name, law) for law in LAWS for name in METHODS if (name, law.name) not in EXCEPTIONS]


@pytest.fixture(autouse=True)
def registered_toy(monkeypatch):
    monkeypatch.setitem(SOLVERS, "toy", toy_method)


@pytest.mark.parametrize(("name", "law"), CASES, ids=lambda value: getattr(value, "name", value))
def test_a_method_keeps_the_law(name, law):
    law.holds(Subject(name, SOLVERS[name], STEADY.get(name, {})))


def test_every_exception_is_needed_and_is_of_a_law_that_is_not_required():
    optional = {law.name: law for law in LAWS if not law.is_required}
    for name, law in EXCEPTIONS:
        with pytest.raises(BrokenLaw):
            optional[law].holds(Subject(name, SOLVERS[name], STEADY.get(name, {})))


@pytest.mark.parametrize("poison", [1e9, np.nan])
def test_nothing_untrusted_is_read_where_dropouts_are_bridged(poison):
    take, subject = takes.gapped(), Subject("pca", SOLVERS["pca"])
    poisoned = takes.make_take(np.where(take.trusted[..., None], take.positions, poison), take.trusted)
    clean, other = subject.answer(take), subject.answer(poisoned)
    assert np.array_equal(clean.filled, other.filled)
    assert np.array_equal(clean.positions[clean.filled], other.positions[other.filled])


MOST = {"rank": 999, "dimension": 999, "states": 64, "neighbours": 9999, "memory": 50}
RANKED = [name for name, module in SOLVERS.items() if MOST.keys() & annotations(module.Params).keys()]


@pytest.mark.parametrize("case", ["one marker", "two frames", "three frames", "constant"])
@pytest.mark.parametrize("name", RANKED)
def test_ranks_above_the_matrix_are_no_matter(name, case):
    large = {key: value for key, value in MOST.items() if key in annotations(SOLVERS[name].Params)}
    subject = Subject(name, SOLVERS[name])
    take = subject.equipped(takes.degenerate()[case])
    check_sane(subject, take, subject.answer(take, **large))
