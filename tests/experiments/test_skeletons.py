"""The bench of skeletons: damage lies where it says, and known rules and methods are counted exactly."""

from functools import partial

import numpy as np
import pytest

from mocapclean.experiments import joint_damage, skeletons
from mocapclean.experiments.joint_damage import DAMAGES, DETECTED, damaged
from mocapclean.experiments.results import Results, Row
from mocapclean.experiments.trials import Capture, Entry
from mocapclean.formats import bvh
from mocapclean.geometry.joint_motion import angles_between, joint_motion
from mocapclean.simulate import perform
from mocapclean.take import Solution
from mocapclean.take.posed import posed_take
from tests import commands

ENTRY = Entry(method="kriging")
run = partial(commands.run, "bench")


@pytest.fixture(scope="module")
def walk():
    performance = perform("walk", 5.0, 120.0, 0)
    return posed_take(performance.bvh, performance.bvh_poses, 120.0)


@pytest.fixture(scope="module")
def amc_walk():
    performance = perform("walk", 5.0, 120.0, 0)
    return posed_take(performance.asf, performance.asf_poses, 120.0)


@pytest.fixture(scope="module")
def capture(walk):
    made = Capture(path=None)
    made.__dict__["posed"] = walk
    return made


def rotations(take):
    return joint_motion(take.skeleton, take.poses, np.isfinite(take.poses)).rotations


@pytest.mark.parametrize(("kind", "size"), DAMAGES)
@pytest.mark.parametrize("which", ["walk", "amc_walk"])
def test_only_the_channels_of_events_differ_and_events_are_apart(request, which, kind, size):
    take = request.getfixturevalue(which)
    copy = damaged(take, kind, size, 0)
    changed = (copy.take.poses != take.poses) | (copy.take.known != take.known)
    assert not changed[~copy.mask].any()
    length = 1 if kind == "pop" else size
    for event in copy.events:
        assert event.stop - event.start == length
        assert changed[event.start : event.stop, list(event.channels)].any()
    starts = np.array([event.start for event in copy.events])
    assert (np.diff(starts) >= length + max(40, 3 * length)).all()
    again = damaged(take, kind, size, 0)
    np.testing.assert_array_equal(again.take.poses, copy.take.poses)
    assert not np.array_equal(damaged(take, kind, size, 1).mask, copy.mask)


@pytest.mark.parametrize("size", [10, 20, 45])
def test_a_pop_turns_a_joint_by_its_size(walk, size):
    copy = damaged(walk, "pop", size, 0)
    assert len({event.joint for event in copy.events}) == len(copy.events)
    for event in copy.events:
        apart = angles_between(rotations(walk)[:, event.joint], rotations(copy.take)[:, event.joint])
        assert apart[event.start] == pytest.approx(size, abs=1e-6)
        assert np.delete(apart, event.start).max() < 1e-6


def test_joints_with_fewer_channels_pop_within_them(amc_walk):
    popped = [e for seed in range(3) for e in damaged(amc_walk, "pop", 20, seed).events if len(e.channels) == 1]
    assert popped
    copy = damaged(amc_walk, "pop", 20, 0)
    for event in copy.events:
        if len(event.channels) == 1:
            moved = copy.take.poses[event.start, event.channels[0]] - amc_walk.poses[event.start, event.channels[0]]
            assert abs(moved) == pytest.approx(20.0)


def test_lost_joints_are_missing_and_a_limb_is_a_joint_and_all_below(walk):
    copy = damaged(walk, "joint lost", 20, 0)
    np.testing.assert_array_equal(np.isnan(copy.take.poses), copy.mask)
    np.testing.assert_array_equal(~copy.take.known, copy.mask)
    for event in damaged(walk, "limb lost", 20, 0).events:
        owners = {walk.skeleton.channels[index].joint for index in event.channels}
        turning = {channel.joint for channel in walk.skeleton.channels if channel.is_rotation}
        assert owners == set(joint_damage.below(walk.skeleton, event.joint)) & turning
        assert len(owners) > 1


def test_spikes_are_scaled_by_the_body_and_zeros_are_zero(walk):
    scale = joint_damage.span_of(walk) / 1700.0
    for event in (copy := damaged(walk, "root spike", 1, 0)).events:
        moved = np.linalg.norm((copy.take.poses - walk.poses)[event.start, list(event.channels)])
        assert 200.0 * scale <= moved <= 800.0 * scale
    copy = damaged(walk, "root zero", 10, 0)
    assert (copy.take.poses[copy.mask] == 0.0).all()


def test_a_hold_keeps_the_frame_before_of_a_joint_that_moves(walk):
    copy = damaged(walk, "hold", 30, 0)
    for event in copy.events:
        held = copy.take.poses[event.start - 1 : event.stop, list(event.channels)]
        assert (held == held[0]).all()
        truth = rotations(walk)[event.start - 1 : event.stop, event.joint]
        assert angles_between(truth[:1], truth).max() >= 5.0


def test_a_span_is_unknown_with_wrong_numbers_in_it(walk):
    copy = damaged(walk, "span", 40, 0)
    np.testing.assert_array_equal(~copy.take.known, copy.mask)
    assert np.isfinite(copy.take.poses).all()
    event = copy.events[0]
    apart = angles_between(rotations(walk)[:, event.joint], rotations(copy.take)[:, event.joint])
    assert 29.0 < apart.max() <= 30.0 + 1e-6


def test_events_lie_where_the_take_is_right(walk):
    right = np.ones(walk.poses.shape, dtype=bool)
    right[:300] = False
    assert all(event.start >= 305 for event in damaged(walk, "pop", 20, 0, right).events)
    assert damaged(walk, "pop", 20, 0, np.zeros_like(right)) is None
    assert damaged(walk.crop(0, 16), "hold", 10, 0) is None


def test_no_root_damage_without_a_root_that_moves(walk):
    still = walk.poses.copy()
    still[:, [index for index, channel in enumerate(walk.skeleton.channels) if not channel.is_rotation]] = 0.0
    still = posed_take(walk.skeleton, still, walk.rate)
    assert damaged(still, "root zero", 10, 0) is None


class Toy:
    """A rule that finds all that differs from the truth, and more, and a method that answers the truth."""

    def __init__(self, monkeypatch, walk, also=(), finds=True, off=None, fills=True, spoils=False):
        self.walk, self.also, self.finds, self.off, self.fills = walk, also, finds, off, fills
        skeletons._judged.cache_clear()
        monkeypatch.setattr(skeletons, "detect", self.detect)
        monkeypatch.setattr(skeletons, "_solution", self.solution)
        if spoils:
            monkeypatch.setattr(skeletons, "merge_poses", self.spoilt)

    def truth(self, take):
        step = round(self.walk.rate / take.rate)
        return self.walk.poses[::step]

    def detect(self, take):
        damage = take.poses != self.truth(take)
        known = take.known.copy()
        if damage.any():
            owned = np.zeros(take.trusted.shape, dtype=bool)
            frames, channels = np.nonzero(damage)
            owned[frames, take.owners[channels]] = True
            rotates = np.array([channel.is_rotation for channel in take.skeleton.channels])
            kind = rotates == rotates[channels[0]]
            if self.finds:
                known &= ~(owned[:, take.owners] & kind)
            for channel in self.also:
                known[np.unique(frames), channel] = False
        return take.with_known(known)

    def solution(self, entry, judged):
        answer = self.truth(judged).copy()
        if self.off is not None:
            answer += self.off
        filled = ~judged.trusted & self.fills
        return Solution(
            positions=judged.positions,
            poses=np.where(judged.known, judged.poses, answer),
            filled=filled,
            sd=np.ones(filled.shape),
            sd_degrees=np.ones(filled.shape),
        )

    def spoilt(self, judged, solution, accepted):
        moved = solution.poses.copy()
        moved[0, :2] += 1.0
        return posed_take(judged.skeleton, moved, judged.rate)


@pytest.mark.parametrize(("kind", "size"), DAMAGES)
def test_a_perfect_rule_and_method_have_full_marks(monkeypatch, walk, capture, kind, size):
    Toy(monkeypatch, walk)
    measures, series = skeletons.run(kind, size, capture, 1, ENTRY, 0)
    n = len(damaged(walk, kind, size, 0).events)
    assert measures["events"] == n
    assert (measures["left"], measures["stepped"], measures["changed"]) == (0, 0, 0)
    assert measures["covered"] == measures["coordinates"]
    np.testing.assert_allclose(series["mm"], 0.0, atol=1e-9)
    assert len(series["mm"]) == n
    if kind in DETECTED:
        assert (measures["found"], measures["partly"], measures["attributed"]) == (n, n, n)
    else:
        assert "found" not in measures


def test_what_is_not_found_is_neither_filled_nor_left(monkeypatch, walk, capture):
    Toy(monkeypatch, walk, finds=False)
    measures, series = skeletons.run("pop", 20, capture, 1, ENTRY, 0)
    assert (measures["found"], measures["partly"], measures["attributed"], measures["left"]) == (0, 0, 0, 0)
    assert np.isnan(series["degrees"]).all()


def test_a_doubt_of_another_joint_is_no_attribution(monkeypatch, walk, capture):
    Toy(monkeypatch, walk, also=[len(walk.skeleton.channels) - 1])
    measures, _ = skeletons.run("root spike", 1, capture, 1, ENTRY, 0)
    assert measures["found"] == measures["events"]
    assert measures["attributed"] == 0


def test_events_without_an_answer_are_left(monkeypatch, walk, capture):
    Toy(monkeypatch, walk, fills=False)
    measures, series = skeletons.run("joint lost", 20, capture, 1, ENTRY, 0)
    assert measures["left"] == measures["events"]
    assert np.isnan(series["mm"]).all()


def test_errors_steps_and_error_bars_are_counted(monkeypatch, walk, capture):
    rotates = np.array([channel.is_rotation for channel in walk.skeleton.channels])
    wrong = np.where(rotates & (np.array([c.axis for c in walk.skeleton.channels]) == 0), 10.0, 0.0)
    Toy(monkeypatch, walk, off=wrong)
    measures, series = skeletons.run("joint lost", 5, capture, 1, ENTRY, 0)
    np.testing.assert_allclose(series["degrees"], 10.0, atol=1e-6)
    assert measures["stepped"] == measures["steps"] == measures["events"]
    assert measures["covered"] < measures["coordinates"]
    assert measures["changed"] == 0


def test_changed_known_channels_are_counted(monkeypatch, walk, capture):
    Toy(monkeypatch, walk, spoils=True)
    measures, _ = skeletons.run("pop", 20, capture, 1, ENTRY, 0)
    assert measures["changed"] == 2


def test_what_is_replaced_in_an_undamaged_take_is_counted(monkeypatch, walk, capture):
    Toy(monkeypatch, walk)
    assert skeletons.run_unchanged(capture, 2, ENTRY, 0)[0] == {
        "rate": 60.0,
        "samples": 300 * len(walk.markers),
        "distrusted": 0,
        "replaced": 0,
    }
    skeletons._judged.cache_clear()

    def doubts(take):
        known = take.known.copy()
        known[10:14, -1] = False
        return take.with_known(known)

    monkeypatch.setattr(skeletons, "detect", doubts)
    measures, _ = skeletons.run_unchanged(capture, 1, ENTRY, 0)
    assert (measures["distrusted"], measures["replaced"]) == (4, 4)
    skeletons._judged.cache_clear()


def test_rates_and_their_groups(walk):
    assert skeletons.decimations(walk) == {"own": 1, "60": 2, "30": 4}
    assert skeletons.decimations(walk.crop(0, 100)) == {"own": 1}
    assert [skeletons.group(rate) for rate in (240.0, 100.0, 60.0, 30.0, 24.0)] == [
        "100+",
        "100+",
        "60",
        *["24-30"] * 2,
    ]


def test_a_ratio_has_a_floor_on_both_errors():
    ours, theirs = np.array([1.0, 0.0, np.nan]), np.array([4.0, 0.005, 1.0])
    assert skeletons.ratio(ours, theirs, 0.01) == pytest.approx(0.5)
    assert skeletons.ratio(ours[2:], theirs[2:], 0.01) is None


def test_tables_unite_rows_by_damage_rate_and_format():
    def row(take, series=None, **values):
        cell = {"format": "bvh", "rate": "own", "damage": "pop", "size": "20"}
        if "samples" in values:
            cell = {"format": "bvh", "rate": "own", "damage": skeletons.UNCHANGED}
        return Row(
            take=take, method="kriging", variant="", parameters="{}", cell=cell, seed=0,
            values={"rate": 60.0, **values}, series=lambda: series or {},
        )  # fmt: skip

    series = {
        "degrees": np.array([1.0, 3.0]),
        "straight degrees": np.array([2.0, 6.0]),
        "mm": np.array([1.0, 1.0]),
        "straight mm": np.array([4.0, 4.0]),
    }
    counts = {"events": 2, "found": 2, "partly": 2, "attributed": 1, "left": 0, "steps": 2, "stepped": 1}
    counts |= {"coordinates": 10, "covered": 9, "kept": 100, "changed": 1}
    rows = (
        row("a", series, **counts),
        row("b", None, **{**counts, "found": 0, "partly": 1, "attributed": 0}),
        row("a", samples=1000, distrusted=3, replaced=2),
        row("b", samples=1000, distrusted=0, replaced=0),
    )
    found, errors, undamaged, listed = skeletons.tables(Results(rows))
    assert found.rows == (("pop", "20", "60", "bvh", "2", "4", "50.0", "25.0", "75.0"),)
    assert errors.rows == (
        ("both", "pop", "20", "60", "bvh", "2", "0", "2.00 / 2.80", "0.500", "0.250", "50.0", "90.0", "99"),
    )
    assert undamaged.rows[0] == ("chosen on", "60", "1", "1", "1000", "200", "300")
    assert listed.rows == (("a", "60", "1000", "2", "3"),)


def test_the_command_runs_on_skeletons_and_lists_what_it_left_out(tmp_path, walk):
    folder = tmp_path / "takes"
    folder.mkdir()
    performance = perform("walk", 2.0, 60.0, 0)
    take = posed_take(performance.bvh, performance.bvh_poses, 60.0)
    bvh.create(take, folder / "walk.bvh")
    bvh.create(take.crop(0, 20), folder / "short.bvh")
    code, text, err = run("skeletons", "--folder", folder, "--quick", "--no-plots", "--out-dir", tmp_path / "out")
    assert (code, err) == (0, "")
    assert "left out: short.bvh (20 frames)" in text
    assert "Undamaged takes" in text
