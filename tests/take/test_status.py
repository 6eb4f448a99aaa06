"""The status of samples: each decision is recorded once, where it is made."""

import numpy as np
import pytest
from c3d_builder import C3D
from hypothesis import given
from hypothesis import strategies as st

from mocapclean.config.loading import resolve
from mocapclean.formats import c3d
from mocapclean.pipeline.inspection import inspect
from mocapclean.pipeline.repair import repair
from mocapclean.take import Finding, Take
from mocapclean.take.status import MEANINGS, Status, decide, detected, first_rules, supplied, supply, withdraw

UNDECIDED = {Status.MISSING, Status.DISTRUSTED}


def test_every_status_has_a_meaning_and_every_reason_a_sentence():
    assert set(MEANINGS) == set(Status)
    for status in Status:
        assert bool(status.sentence) == MEANINGS[status].startswith("left: ")
    assert len({status.sentence for status in Status if status.sentence}) == sum(bool(s.sentence) for s in Status)


@given(st.lists(st.sampled_from(Status), min_size=1, max_size=40), st.sampled_from(Status), st.data())
def test_a_decision_changes_only_undecided_samples(before, status, data):
    where = np.array(data.draw(st.lists(st.booleans(), min_size=len(before), max_size=len(before))))
    codes = np.array(before, dtype=np.uint8)
    decide(codes, where, status)
    for old, new, asked in zip(before, codes.tolist(), where.tolist(), strict=True):
        assert new == (status if asked and old in UNDECIDED else old)


@given(st.lists(st.sampled_from(Status), min_size=1, max_size=40))
def test_supplied_samples_were_missing_or_distrusted_and_can_be_withdrawn(before):
    codes = np.array(before, dtype=np.uint8)
    everywhere = np.ones(len(before), dtype=bool)
    supply(codes, everywhere)
    expected = {Status.MISSING: Status.FILLED, Status.DISTRUSTED: Status.REPLACED}
    assert codes.tolist() == [expected.get(old, old) for old in before]
    by_method = supplied(codes)
    withdraw(codes, everywhere, Status.NO_POSE)
    assert (codes[by_method] == Status.NO_POSE).all()
    assert not supplied(codes).any()


def test_the_first_rule_that_distrusts_a_sample_is_named():
    trusted = np.ones((10, 2), dtype=bool)
    trusted[2:5, 0] = trusted[7, 1] = False
    findings = (
        Finding(rule="missing", message="", marker="a", frames=(2, 4)),
        Finding(rule="spike", message="", marker="a", frames=(3, 5)),
        Finding(rule="jump", message="", marker="b", frames=(7, 9)),
        Finding(rule="units", message="of the whole take"),
    )
    take = Take(positions=np.zeros((10, 2, 3)), trusted=trusted, markers=("a", "b"), rate=50.0, findings=findings)
    rules, names = first_rules(take)
    assert [names[index] for index in rules[:, 0]] == ["", "", "missing", "missing", "spike", "", "", "", "", ""]
    assert [names[index] for index in rules[:, 1]] == [*[""] * 7, "jump", "", ""]
    assert detected(take)[2:5, 0].tolist() == [Status.MISSING, Status.MISSING, Status.DISTRUSTED]


@pytest.fixture
def broken(tmp_path):
    """A C3D of 5 markers in integers with gaps that meet a different end each."""
    frames = np.arange(200)
    points = np.zeros((200, 5, 4))
    points[..., :3] = 100 * np.arange(1, 6)[:, None] + 50 * np.sin(frames / 20)[:, None, None]
    points[:, 0] = [0, 0, 0, -1]  # never seen
    points[50:55, 1] = [0, 0, 0, -1]  # short
    points[90:140, 1] = [0, 0, 0, -1]  # long
    points[190:, 2] = [0, 0, 0, -1]  # at the end
    points[20:24, 3] = [0, 0, 0, -1]
    points[160] = [0, 0, 0, -1]  # nothing is seen
    path = tmp_path / "take.c3d"
    path.write_bytes(C3D(points, is_float=False).build())
    return path


def statuses(path, **options):
    """The status of each gap by marker and first frame, and the numbers of samples."""
    options = {"method": "linear", "self_check": False, **options}
    outcome = repair(path, path.with_name("out.c3d"), resolve(None, {"overwrite": True, **options}))
    assert outcome.status != "failed", outcome.error
    return {(gap.marker, gap.start): gap.status for gap in outcome.gaps}, outcome


def test_each_reason_is_recorded_where_it_is_decided(broken):
    gaps, outcome = statuses(broken, max_gap=20, exclude=["M5"], markers=["M1", "M2", "M3", "M4"])
    assert gaps["M1", 0] == Status.NEVER_SEEN
    assert gaps["M2", 50] == Status.FILLED
    assert gaps["M2", 90] == Status.TOO_LONG
    assert gaps["M3", 190] == Status.AT_END
    assert gaps["M2", 160] == Status.FILLED
    assert outcome.statuses[Status.TOO_LONG] == 50
    assert sum(outcome.statuses.values()) == outcome.counts.samples
    gaps, _ = statuses(broken, markers=["M2"])
    assert gaps["M4", 20] == Status.NOT_ASKED_FOR


def test_a_dropout_of_all_markers_is_left_where_it_is_longer_than_a_path_over_time_bridges(tmp_path):
    points = np.zeros((200, 4, 4))
    points[..., :3] = 100 * np.arange(1, 5)[:, None] + 50 * np.sin(np.arange(200) / 20)[:, None, None]
    points[100:150] = [0, 0, 0, -1]
    path = tmp_path / "take.c3d"
    path.write_bytes(C3D(points, is_float=False).build())
    assert set(statuses(path, method="svt")[0].values()) == {Status.NOTHING_SEEN}
    assert set(statuses(path, method="linear")[0].values()) == {Status.FILLED}


def test_distrusted_samples_that_a_method_supplies_are_replaced(broken, tmp_path):
    spans = tmp_path / "bad.csv"
    spans.write_text("M4,101,110\n")
    gaps, outcome = statuses(broken, gaps=str(spans))
    assert gaps["M4", 100] == Status.REPLACED
    assert outcome.counts.replaced == outcome.statuses[Status.REPLACED] == 10
    assert outcome.counts.filled == outcome.statuses[Status.FILLED] + 10


def test_where_no_method_ran_no_method_is_blamed(broken):
    outcome = inspect(broken, resolve(None, {}))
    assert {gap.status for gap in outcome.gaps} == {Status.MISSING}
    assert not any(gap.status.sentence for gap in outcome.gaps)


def test_an_answer_that_the_file_would_store_as_missing_is_told_as_such(tmp_path):
    """A marker that passes through the origin in a gap: 0, 0, 0 is the mark of a missing sample."""
    positions = np.zeros((41, 2, 3))
    positions[:, 0] = np.linspace(-200.0, 200.0, 41)[:, None]
    positions[:, 1] = [300.0, 100.0, 50.0]
    trusted = np.ones((41, 2), dtype=bool)
    trusted[18:23, 0] = False
    path = tmp_path / "origin.c3d"
    c3d.create(Take(positions=positions, trusted=trusted, markers=("a", "b"), rate=60.0), path)
    _, outcome = statuses(path)
    assert outcome.statuses[Status.STORED_AS_MISSING] == 1
    assert outcome.statuses[Status.FILLED] == 4
