"""Spikes and jumps: one boundary between the two rules, whatever their parameters."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from mocapclean import detection
from mocapclean.detection import RULES, detect
from mocapclean.detection.evidence import Evidence
from mocapclean.take import Take

LONGEST = 9
SETTINGS = list(product(range(1, LONGEST), range(1, LONGEST)))


@pytest.fixture
def claims(monkeypatch):
    """Return a function that finds which rules claim excursions of 1, 2, ... frames, by the rules' parameters."""
    lengths = range(1, LONGEST + 1)
    deviation = np.zeros((LONGEST + 2, LONGEST))
    for marker, length in enumerate(lengths):
        deviation[1 : 1 + length, marker] = 30.0
    take = Take(
        positions=np.zeros((*deviation.shape, 3)),
        trusted=np.ones(deviation.shape, dtype=bool),
        markers=tuple(f"M{length}" for length in lengths),
        rate=100.0,
    )
    bursts = np.zeros(deviation.shape, dtype=bool)

    def prepared(take):
        evidence = Evidence(take)
        threshold = np.full(deviation.shape, 10.0)
        analysis = SimpleNamespace(deviation=deviation, threshold=threshold, bursts=bursts, leaps=())
        evidence.__dict__["analysis"] = analysis
        return evidence

    monkeypatch.setattr(detection, "Evidence", prepared)

    def claimed(**rules):
        params = {name: RULES[name].Params(**params) for name, params in rules.items()}
        result = detect(take, params, replace="suspicious")
        assert not any("also found by" in finding.message for finding in result.findings)
        for finding in result.findings:
            assert finding.frames == (1, 1 + int(finding.marker[1:]))
        rules = {int(finding.marker[1:]): finding.rule for finding in result.findings}
        claimed_lengths = np.isin(lengths, list(rules))
        np.testing.assert_array_equal(result.trusted, ~((deviation > 0) & claimed_lengths))
        return rules

    return claimed


@pytest.mark.parametrize(("longest", "shortest"), SETTINGS)
def test_every_length_is_claimed_by_exactly_one_rule(claims, longest, shortest):
    rules = claims(spike={"longest": longest}, jump={"shortest": shortest})
    assert sorted(rules) == list(range(1, LONGEST + 1))
    names = [rules[length] for length in sorted(rules)]
    assert names == sorted(names, reverse=True)


@pytest.mark.parametrize(
    ("longest", "shortest", "last_spike"), [(3, 4, 3), (1, 4, 1), (6, 4, 6), (3, 8, 7), (3, 2, 1), (3, 1, 0), (5, 8, 5)]
)
def test_the_changed_parameter_sets_the_boundary(claims, longest, shortest, last_spike):
    rules = claims(spike={"longest": longest}, jump={"shortest": shortest})
    assert sum(rule == "spike" for rule in rules.values()) == last_spike


@pytest.mark.parametrize(("longest", "shortest"), [(3, 4), (1, 4), (2, 7), (5, 2)])
def test_a_rule_alone_keeps_its_range(claims, longest, shortest):
    spikes = claims(spike={"longest": longest}, jump={"shortest": shortest, "enabled": False})
    assert spikes == dict.fromkeys(range(1, longest + 1), "spike")
    jumps = claims(spike={"longest": longest, "enabled": False}, jump={"shortest": shortest})
    assert jumps == dict.fromkeys(range(shortest, LONGEST + 1), "jump")
