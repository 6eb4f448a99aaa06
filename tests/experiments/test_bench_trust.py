"""The bench of the trust rules: what it counts, on a simulated take."""

import numpy as np
import pytest

from mocapclean.experiments import trust
from mocapclean.experiments.trials import Capture, Entry, Request
from mocapclean.formats import c3d
from mocapclean.simulate import FAULTS, perform


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    path = tmp_path_factory.mktemp("takes") / "walk.c3d"
    c3d.create(perform("walk", 3.0, 120.0, 0).markers, path)
    return Capture(path=path)


@pytest.fixture(scope="module")
def rows(capture):
    """Measures by set of rules: on the take with the smallest faults, and as it is."""
    entry = Entry(method="linear")
    return {
        (rules, size): trust.run(capture, entry, rules, size, 0)[0]
        for size in (0, 1)
        for rules in trust.EVERYWHERE
        if size or rules != "truth"
    }


def test_the_truth_is_right_in_all(rows):
    truth = rows["truth", 1]
    assert truth["right"] == truth["faulty"] > 0
    assert truth["wrong"] == 0
    assert all(truth[f"{kind} found"] == truth[f"{kind} events"] > 0 for kind in FAULTS)


def test_all_rules_find_more_than_tdd_and_put_swaps_back(rows):
    ours, tdd = rows["all", 1], rows["tdd", 1]
    assert sum(ours[f"{kind} found"] for kind in FAULTS) > sum(tdd[f"{kind} found"] for kind in FAULTS)
    assert ours["swaps_exact"] == ours["swap events"]
    assert ours["rmse"] < tdd["rmse"]


def test_a_clean_take_has_nothing_right(rows):
    assert rows["all", 0]["wrong"] == 0
    for rules in ("all", "tdd", "hampel"):
        assert rows[rules, 0]["right"] == rows[rules, 0]["faulty"] == 0


def test_quick_runs_fewer(capture):
    quick, whole = (trust.trials(Request(captures=(capture,), quick=quick)) for quick in (True, False))
    assert {trial.entry.variant for trial in quick} == set(trust.EVERYWHERE)
    assert {trial.entry.variant for trial in whole} == set(trust.SETS)
    assert {trial.cell["size"] for trial in whole} == {"0", "1", "2", "4"}


def test_hampel_flags_what_leaves_its_window():
    rng = np.random.default_rng(0)
    positions = np.cumsum(np.full((60, 2, 3), 2.0), axis=0) + rng.normal(size=(60, 2, 3)) * 0.01
    positions[30, 1, 2] += 50.0
    trusted = np.ones((60, 2), bool)
    trusted[40, 0] = False
    found = trust.hampel(positions, trusted)
    assert found[30, 1]
    assert not found[40, 0]
    assert found[20:40].sum() == 1
