"""The figure, its motions and markers, and the ways to lose samples."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from mocapclean.arrays import Bools, Floats
from mocapclean.errors import UsageError
from mocapclean.geometry.skeleton import forward
from mocapclean.simulate import (
    MARKERS,
    MOTIONS,
    Performance,
    block_loss,
    hide,
    lose_channels,
    occlude,
    perform,
    random_loss,
    single_gaps,
)
from mocapclean.simulate.figure import BODY, STATURE, angles_of, asf_skeleton, rotation

RATE = 120.0
_DONE: dict[str, Performance] = {}


@pytest.fixture(params=sorted(MOTIONS))
def performance(request: pytest.FixtureRequest) -> Performance:
    if request.param not in _DONE:
        _DONE[request.param] = perform(request.param, 12.0, RATE, seed=4)
    return _DONE[request.param]


def track(performance: Performance, marker: str) -> Floats:
    return performance.markers.positions[:, performance.markers.markers.index(marker)]


def speed(points: Floats) -> Floats:
    """Metres per second."""
    return np.linalg.norm(np.gradient(points, axis=0), axis=1) * RATE / 1000


def gaps(missing: Bools) -> list[int]:
    """Lengths of all gaps."""
    lengths = []
    for column in missing.T:
        lengths += [len(list(run)) for lost, run in itertools.groupby(column) if lost]
    return lengths


def test_the_figure_stands_as_tall_as_it_should() -> None:
    skeleton = asf_skeleton()
    places, _ = forward(skeleton, np.zeros((1, len(skeleton.channels))))
    sole = STATURE * (-0.550 + 0.039)
    by_name = dict(zip(skeleton.names, places[0], strict=True))
    assert by_name["head"][1] == pytest.approx(0.450 * STATURE)
    assert by_name["ltibia"][1] == pytest.approx(sole)
    assert by_name["lhumerus"][0] - by_name["rhumerus"][0] == pytest.approx(0.258 * STATURE)


def test_bvh_and_asf_tell_the_same_motion(performance: Performance) -> None:
    in_bvh, _ = forward(performance.bvh, performance.bvh_poses)
    in_asf, _ = forward(performance.asf, performance.asf_poses)
    pairs = [(s.joint, s.parent) for s in BODY if s.joint] + [(s.end, s.bone) for s in BODY if s.end]
    assert len(pairs) == len(performance.bvh.names) - 1
    for joint, bone in pairs:
        here, there = performance.bvh.names.index(joint), performance.asf.names.index(bone)
        assert np.allclose(in_bvh[:, here], in_asf[:, there], atol=1e-8)


def test_bones_keep_their_lengths(performance: Performance) -> None:
    for skeleton, poses in (
        (performance.bvh, performance.bvh_poses),
        (performance.asf, performance.asf_poses),
    ):
        places, _ = forward(skeleton, poses)
        bones = skeleton.bones()
        assert len(bones) == len(skeleton.names) - 1
        for bone in bones:
            ends = places[:, [skeleton.names.index(bone.start), skeleton.names.index(bone.end)]]
            assert np.allclose(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1), bone.length)


def test_angles_are_smooth_and_far_from_gimbal_lock(performance: Performance) -> None:
    for skeleton, poses in (
        (performance.bvh, performance.bvh_poses),
        (performance.asf, performance.asf_poses),
    ):
        for index, channel in enumerate(skeleton.channels):
            if channel.is_rotation:
                assert np.abs(np.diff(poses[:, index])).max() < 15
            if channel.is_rotation and channel.axis == 1:
                assert np.abs(poses[:, index]).max() < 85


def test_angles_of_undoes_rotation(rng: np.random.Generator) -> None:
    angles = np.cumsum(rng.normal(0, 2, (200, 3)), axis=0)
    angles[:, 1] *= 60 / np.abs(angles[:, 1]).max()
    angles[0] = 0
    angles[:, 0] = np.linspace(0, 500, 200)
    assert np.allclose(angles_of(rotation(angles)) - angles, 0.0, atol=1e-9)


def test_a_seed_settles_everything(performance: Performance) -> None:
    again = perform(performance.name, 12.0, RATE, seed=4)
    other = perform(performance.name, 12.0, RATE, seed=5)
    assert np.array_equal(again.markers.positions, performance.markers.positions)
    assert np.array_equal(again.bvh_poses, performance.bvh_poses)
    assert np.array_equal(again.asf_poses, performance.asf_poses)
    assert np.abs(other.bvh_poses - performance.bvh_poses).max() > 1


def test_the_take_is_whole(performance: Performance) -> None:
    take = performance.markers
    assert take.positions.shape == (1440, 41, 3)
    assert take.markers == tuple(MARKERS)
    assert take.trusted.all()
    assert np.isfinite(take.positions).all()
    assert take.rate == RATE


def test_z_is_up_and_the_left_is_left(performance: Performance) -> None:
    head, heel = track(performance, "LFHD"), track(performance, "LHEE")
    assert np.all(head[:, 2] > heel[:, 2] + 800)
    assert np.all(track(performance, "LFWT")[:, 1] > track(performance, "RFWT")[:, 1])
    assert np.all(track(performance, "LTOE")[:, 0] > track(performance, "LHEE")[:, 0])


@pytest.mark.parametrize("seed", range(4))
def test_walking_is_human(seed: int) -> None:
    walk = perform("walk", 10.0, RATE, seed)
    hips = np.mean([track(walk, name) for name in ("LFWT", "RFWT", "LBWT", "RBWT")], axis=0)
    assert 1.15 < (hips[-1, 0] - hips[0, 0]) / 10_000 < 1.45
    assert 20 < np.ptp(hips[:, 2]) < 75
    assert 3.2 < speed(track(walk, "LTOE")).max() < 5.5
    assert speed(track(walk, "LFIN")).max() < 4.0
    toe = track(walk, "LTOE")
    planted = toe[:, 2] < np.median(toe[:, 2]) + 3
    assert planted.mean() > 0.3
    assert np.median(speed(toe)[planted]) < 0.15
    assert toe[:, 2].min() > 5


@pytest.mark.parametrize("seed", range(4))
def test_boxing_is_human(seed: int) -> None:
    boxing = perform("boxing", 15.0, RATE, seed)
    fastest = max(speed(track(boxing, name)).max() for name in ("LWRA", "RWRA"))
    assert 5.0 < fastest < 12.0
    assert speed(track(boxing, "CLAV")).max() < 3.5
    assert np.ptp(track(boxing, "LFWT")[:, :2], axis=0).max() < 1200
    for name in ("LTOE", "RTOE"):
        assert np.median(speed(track(boxing, name))) < 0.2


@pytest.mark.parametrize(
    ("first", "second", "low", "high"),
    [
        ("LFHD", "RBHD", 0.3, 3.0),
        ("C7", "T10", 0.8, 9.0),
        ("LFWT", "RBWT", 0.8, 8.0),
        ("LTHI", "LKNE", 0.8, 5.0),
        ("LELB", "LUPA", 0.5, 5.0),
        ("LWRA", "LWRB", 0.4, 5.0),
        ("LHEE", "LMT5", 0.5, 9.0),
    ],
)
def test_skin_moves_as_on_real_people(
    performance: Performance, first: str, second: str, low: float, high: float
) -> None:
    """Standard deviations of distances within a segment, millimetres; the bounds span those of real takes."""
    distance = np.linalg.norm(track(performance, first) - track(performance, second), axis=1)
    assert low < distance.std() < high


def test_markers_carry_noise_of_the_stated_size(performance: Performance) -> None:
    third = np.diff(track(performance, "CLAV"), n=3, axis=0)
    assert 0.1 < np.median(np.abs(third)) / 0.6745 / np.sqrt(20) < 0.3


@pytest.mark.parametrize("share", [0.02, 0.05, 0.15, 0.3])
def test_occlusions_are_as_many_and_as_long_as_stated(performance: Performance, share: float) -> None:
    missing = occlude(performance.markers, np.random.default_rng(7), share)
    lengths = gaps(missing)
    assert share <= missing.mean() < share + 0.01
    assert min(lengths) >= 3
    assert max(lengths) <= 150
    assert 6 <= np.median(lengths) <= 30
    assert missing.mean(axis=0).max() <= 0.8


def test_occlusions_favour_hands_over_heads(performance: Performance) -> None:
    take = performance.markers
    missing = np.mean([occlude(take, np.random.default_rng(seed), 0.1) for seed in range(8)], axis=0)
    rate = dict(zip(take.markers, missing.mean(axis=0), strict=True))
    hands = np.mean([rate[name] for name in ("LWRB", "RWRB", "LFIN", "RFIN")])
    heads = np.mean([rate[name] for name in ("LBHD", "RBHD", "C7", "T10")])
    assert hands > 1.5 * heads


def test_neighbours_of_a_segment_are_sometimes_lost_together(performance: Performance) -> None:
    take = performance.markers
    names = take.markers
    missing = np.concatenate([occlude(take, np.random.default_rng(seed), 0.05) for seed in range(8)])
    wrist, other, foot = (missing[:, names.index(name)] for name in ("LWRA", "LWRB", "RTOE"))
    assert (wrist & other).mean() > 1.5 * (wrist & foot).mean()


def test_occlude_reads_only_what_is_trusted(performance: Performance) -> None:
    take = performance.markers
    lost = np.zeros(take.trusted.shape, dtype=bool)
    lost[100:400, 3] = True
    one, other = (
        replace(take, positions=np.where(lost[..., None], wild, take.positions), trusted=~lost) for wild in (0.0, 1e9)
    )
    first, second = (occlude(t, np.random.default_rng(1)) for t in (one, other))
    assert np.array_equal(first, second)


def test_hide_tells_nothing_of_the_truth(performance: Performance) -> None:
    missing = occlude(performance.markers, np.random.default_rng(2))
    hidden = hide(performance.markers, missing)
    assert np.array_equal(hidden.trusted, ~missing)
    assert not hidden.positions[missing].any()
    assert np.array_equal(hidden.positions[~missing], performance.markers.positions[~missing])


@pytest.mark.parametrize(("ratio", "out"), [(0.0, 0), (0.2, 8), (0.6, 25), (1.0, 41)])
def test_random_loss_takes_as_many_from_each_frame(rng: np.random.Generator, ratio: float, out: int) -> None:
    missing = random_loss(300, 41, ratio, rng)
    assert np.all(missing.sum(axis=1) == out)
    assert out in (0, 41) or np.ptp(missing.sum(axis=0)) > 0
    assert np.abs(missing.mean(axis=0) - out / 41).max() < 0.15


def test_block_loss_changes_its_markers_with_each_block(rng: np.random.Generator) -> None:
    missing = block_loss(310, 31, 60, 6, rng)
    assert np.all(missing.sum(axis=1) == 6)
    starts = np.arange(0, 310, 60)
    for start in starts:
        block = missing[start : start + 60]
        assert np.all(block == block[0])
    assert any(not np.array_equal(missing[a], missing[b]) for a, b in itertools.pairwise(starts))


def test_single_gaps_follow_their_recipe() -> None:
    missing = single_gaps(500, 41, 5, 120, np.random.default_rng(3))
    assert sorted(missing.sum(axis=0))[-6:] == [0, 120, 120, 120, 120, 120]
    assert gaps(missing) == [120] * 5
    assert not missing[:10].any()
    assert not missing[-10:].any()
    draws = np.random.default_rng(3)
    expected = np.zeros_like(missing)
    for marker in draws.choice(41, 5, replace=False):
        start = draws.integers(10, 500 - 120 - 10)
        expected[start : start + 120, marker] = True
    assert np.array_equal(missing, expected)


def test_lost_channels_are_ends_of_limbs_for_some_frames(performance: Performance) -> None:
    for skeleton, poses in (
        (performance.bvh, performance.bvh_poses),
        (performance.asf, performance.asf_poses),
    ):
        broken = lose_channels(skeleton, poses, np.random.default_rng(0), n_spans=3)
        lost = np.isnan(broken)
        assert np.array_equal(broken[~lost], poses[~lost])
        assert not lost[:, :6].any()
        assert np.isfinite(poses).all()
        assert 20 <= lost.any(axis=1).sum() <= 180
        places, _ = forward(skeleton, broken)
        torn = np.isnan(places).any(axis=(0, 2))
        assert 0 < torn.sum() < len(skeleton.names) / 2
        for index, channel in enumerate(skeleton.channels):
            parent = skeleton.parents[channel.joint]
            above = [i for i, c in enumerate(skeleton.channels) if c.joint == parent and c.is_rotation]
            if channel.is_rotation and above:
                assert np.all(lost[:, index] >= lost[:, above].any(axis=1))


def test_no_spans_lose_nothing(performance: Performance) -> None:
    kept = lose_channels(performance.bvh, performance.bvh_poses, np.random.default_rng(0), n_spans=0)
    assert np.array_equal(kept, performance.bvh_poses)


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda r, p: perform("swim"), "walk, boxing. Got swim"),
        (lambda r, p: perform("walk", 0.5), "between 1 and 600. Got 0.5"),
        (lambda r, p: perform("walk", float("nan")), "Got nan"),
        (lambda r, p: perform("walk", 5, 10), "rate in Hz"),
        (lambda r, p: perform("walk", 5, 100, -1), "seed"),
        (lambda r, p: perform("walk", 5, 100, 1.5), "whole number"),
        (lambda r, p: occlude(p.markers, r, 0.4), "between 0 and 0.3"),
        (lambda r, p: random_loss(10, 41, 1.1, r), "ratio"),
        (lambda r, p: random_loss(0, 41, 0.1, r), "frames"),
        (lambda r, p: block_loss(10, 5, 0, 1, r), "length"),
        (lambda r, p: block_loss(10, 5, 5, 6, r), "between 0 and 5. Got 6"),
        (lambda r, p: single_gaps(50, 5, 1, 30, r), "more than 50. Got 50"),
        (lambda r, p: single_gaps(50, 5, 6, 10, r), "markers out"),
        (lambda r, p: lose_channels(p.bvh, p.bvh_poses[:30], r), "longest"),
        (lambda r, p: lose_channels(p.bvh, p.bvh_poses[:10], r), "shortest"),
        (lambda r, p: lose_channels(p.bvh, p.bvh_poses, r, -1), "lost spans"),
    ],
)
def test_what_cannot_be_done_is_refused(rng: np.random.Generator, ask, said: str) -> None:  # type: ignore[no-untyped-def]
    performance = perform("walk", 1.0, 60.0)
    with pytest.raises(UsageError, match=said):
        ask(rng, performance)


def test_a_take_too_short_for_its_share_is_refused() -> None:
    take = perform("walk", 1.0, 30.0).markers
    tiny = take.crop(0, 1)
    with pytest.raises(UsageError, match="ask for less"):
        occlude(tiny, np.random.default_rng(0), 0.3)


@pytest.mark.parametrize("rate", [30.0, 60.0, 250.0])
def test_other_rates_tell_the_same_sort_of_motion(rate: float) -> None:
    for motion in MOTIONS:
        take = perform(motion, 4.0, rate, seed=2).markers
        assert len(take.positions) == round(4 * rate)
        missing = occlude(take, np.random.default_rng(0), 0.05)
        assert max(gaps(missing)) <= round(1.25 * rate)
