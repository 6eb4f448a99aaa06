"""A rule is a module and a line in the registry: toy rules through ``detect``."""

from types import SimpleNamespace

import numpy as np
import pytest

from mocapclean.detection import RULES, detect
from mocapclean.detection.rule import Switch, findings
from mocapclean.take import Take


@pytest.fixture
def take(rng):
    """Return 20 frames of 4 resting markers, of which one sample is missing."""
    trusted = np.ones((20, 4), dtype=bool)
    trusted[3, 1] = False
    return Take(positions=rng.normal(size=(20, 4, 3)) * 100, trusted=trusted, markers=tuple("ABCD"), rate=100.0)


def rule(name, examine, **declared):
    """Return a toy rule without parameters of its own, which distrusts the samples that ``examine`` returns."""

    def examined(evidence, params):
        distrusted = examine(evidence.take)
        return distrusted, tuple(
            findings(name, evidence.take, distrusted, lambda marker, start, stop: "too high", "look")
        )

    return SimpleNamespace(Params=Switch, examine=examined, **declared)


def span(start, stop, marker):
    distrusted = np.zeros((20, 4), dtype=bool)
    distrusted[start:stop, marker] = True
    return distrusted


def test_one_line_in_the_registry_makes_a_rule(take, monkeypatch):
    monkeypatch.setitem(RULES, "toy", rule("toy", lambda take: span(5, 9, 2)))
    result = detect(take, {"toy": Switch()}, replace="suspicious")
    np.testing.assert_array_equal(result.trusted, take.trusted & ~span(5, 9, 2))
    assert [(f.rule, f.level, f.marker, f.frames) for f in result.findings] == [("toy", "warning", "C", (5, 9))]
    assert "toy" in {finding.rule for finding in detect(take).findings}
    assert detect(take, {"toy": Switch()}).trusted.sum() == take.trusted.sum()
    assert detect(take, {"toy": Switch(enabled=False)}, replace="suspicious").trusted.sum() == take.trusted.sum()


def test_no_rule_raises_trust(take, monkeypatch):
    monkeypatch.setitem(RULES, "mild", rule("mild", lambda take: np.zeros((20, 4), dtype=bool)))
    monkeypatch.setitem(RULES, "strict", rule("strict", lambda take: span(0, 4, 0)))
    monkeypatch.setitem(RULES, "opposite", rule("opposite", lambda take: ~take.trusted, AFTER_OTHERS=True))
    rules = {"strict": Switch(), "mild": Switch(), "opposite": Switch()}
    result = detect(take, rules, replace="suspicious")
    np.testing.assert_array_equal(result.trusted, take.trusted & ~span(0, 4, 0))


def test_no_rule_can_change_the_take(take, monkeypatch):
    def trust_all(take):
        take.trusted[:] = True

    monkeypatch.setitem(RULES, "toy", rule("toy", trust_all))
    with pytest.raises(ValueError, match="read-only"):
        detect(take, {"toy": Switch(replace="always")})


@pytest.mark.parametrize("declared", [{}, {"AFTER_OTHERS": True}])
def test_a_rule_after_the_others_sees_what_they_trust(take, monkeypatch, declared):
    trust_seen = []

    def look_on(take):
        trust_seen.append(take.trusted.copy())
        return np.zeros((20, 4), dtype=bool)

    monkeypatch.setitem(RULES, "onlooker", rule("onlooker", look_on, **declared))
    monkeypatch.setitem(RULES, "toy", rule("toy", lambda take: span(5, 9, 2)))
    detect(take, {"onlooker": Switch(replace="always"), "toy": Switch(replace="always")})
    np.testing.assert_array_equal(trust_seen, [take.trusted & ~span(5, 9, 2) if declared else take.trusted])
