"""What is right stays trusted: markers without a segment, poses at the ends, and all that no path encloses."""

from dataclasses import replace

import numpy as np
import pytest

from mocapclean.detection import RULES, detect
from mocapclean.detection.evidence import Evidence
from mocapclean.errors import UsageError
from mocapclean.geometry.skeleton import move
from mocapclean.simulate import perform
from mocapclean.take import Take

SEGMENT_RULES = {"drift", "frozen", "bone", "predict", "swap"}


@pytest.fixture(scope="module")
def walk():
    """Markers of four seconds of walking at 100 Hz, all trusted."""
    return perform("walk", 4.0, 100.0, 3).markers


@pytest.fixture(scope="module")
def joints():
    """The joints of a walk of five seconds at 60 Hz."""
    walking = perform("walk", 5.0, 60.0, 4)
    positions = move(walking.asf, walking.asf_poses).positions
    return Take(positions=positions, trusted=np.ones(positions.shape[:2], bool), markers=walking.asf.names, rate=60.0)


def with_marker(take, name, path, **arrays):
    """Return a take with one marker more, on a path (F, 3)."""
    return Take(
        positions=np.concatenate([take.positions, path[:, None]], axis=1),
        trusted=np.concatenate([take.trusted, np.ones((len(path), 1), bool)], axis=1),
        markers=(*take.markers, name),
        rate=take.rate,
        **arrays,
    )


def displaced(take, name, start, stop, offset):
    positions = take.positions.copy()
    positions[start:stop, take.markers.index(name)] += offset
    return replace(take, positions=positions)


def lost(take, name=None):
    """Return the frames of a marker, or the samples of all, that detection with the defaults distrusts."""
    samples = take.trusted & ~detect(take).trusted
    return samples if name is None else np.flatnonzero(samples[:, take.markers.index(name)]).tolist()


def told(take, name, **options):
    return [finding for finding in detect(take, **options).findings if finding.marker == name]


def still(rng, take, place, noise):
    return np.array(place) + rng.normal(scale=noise, size=(len(take.trusted), 3))


def thrown(take, at, velocity, bounce=1.0):
    """Return the path of a ball that rests, is thrown in frame ``at``, and bounces on the floor."""
    path = np.tile([900.0, -600.0, 1000.0], (len(take.trusted), 1))
    position, speed = path[0].copy(), np.array(velocity)
    for frame in range(at, len(path)):
        position += speed / take.rate
        speed -= np.array([0.0, 0.0, 9810.0]) / take.rate
        if position[2] < 0.0:
            position[2], speed[2] = -bounce * position[2], -bounce * speed[2]
        path[frame] = position
    return path


@pytest.mark.parametrize("place", [(1500.0, 800.0, 50.0), (-300.0, 4000.0, 0.0), (0.0, 700.0, 900.0)])
@pytest.mark.parametrize("noise", [0.0, 0.1, 0.6])
def test_nothing_is_said_of_a_marker_on_the_floor(rng, walk, place, noise):
    take = with_marker(walk, "FLOOR", still(rng, walk, place, noise))
    assert not told(take, "FLOOR")
    assert not lost(take).any()
    assert not Evidence(take).analysis.predicted[-1]
    assert Evidence(take).analysis.predicted[:-1].all()


@pytest.mark.parametrize("at", [120, 200, 330])
@pytest.mark.parametrize("velocity", [(2500.0, 500.0, 3000.0), (-1200.0, 2000.0, 0.0)])
def test_a_ball_that_rests_and_is_thrown_keeps_every_sample(rng, walk, at, velocity):
    take = with_marker(walk, "BALL", thrown(walk, at, velocity, bounce=0.8) + rng.normal(scale=0.2, size=(400, 3)))
    assert not lost(take).any()
    assert not {finding.rule for finding in told(take, "BALL")} & SEGMENT_RULES


@pytest.mark.parametrize(("start", "stop"), [(100, 160), (250, 300)])
def test_a_cup_that_is_moved_once_keeps_every_sample(rng, walk, start, stop):
    share = np.clip((np.arange(400) - start) / (stop - start), 0.0, 1.0)
    smooth = (share**2 * (3 - 2 * share))[:, None]
    path = still(rng, walk, (400.0, 500.0, 950.0), 0.2) + smooth * [300.0, -500.0, 120.0]
    take = with_marker(walk, "CUP", path)
    assert not lost(take).any()
    assert not told(take, "CUP")


def test_a_marker_that_drifts_keeps_its_segment(walk):
    take = displaced(walk, "LTHI", 200, 400, [0.0, 25.0, 30.0])
    assert Evidence(take).analysis.predicted.all()
    assert {finding.rule for finding in told(take, "LTHI")} == {"drift"}
    assert not lost(take).any()


@pytest.mark.parametrize("frames", [slice(0, 1), slice(0, 25), slice(280, 300)])
def test_a_pose_at_an_end_is_no_fault(joints, frames):
    positions = joints.positions.copy()
    skeleton = perform("walk", 1.0, 60.0, 4).asf
    pose = move(skeleton, np.zeros((1, len(skeleton.channels)))).positions[0]
    positions[frames] += (pose - pose[0]) - (positions[frames] - positions[frames, :1])
    assert not lost(replace(joints, positions=positions)).any()


def test_a_foot_that_stands_at_the_end_is_not_frozen(joints):
    positions = joints.positions.copy()
    foot = joints.markers.index("lfoot")
    positions[270:, foot] = positions[270, foot]
    assert not {finding.rule for finding in told(replace(joints, positions=positions), "lfoot")} & {"frozen"}


@pytest.mark.parametrize(
    ("start", "stop", "acts"), [(150, 151, True), (150, 153, True), (150, 156, True), (150, 200, False), (0, 2, False)]
)
def test_only_a_short_excursion_that_its_path_encloses_is_distrusted(walk, start, stop, acts):
    take = displaced(walk, "RFHD", start, stop, [0.0, 0.0, 60.0])
    assert lost(take, "RFHD") == (list(range(start, stop)) if acts else [])
    findings = told(take, "RFHD")
    assert findings
    assert all(finding.suspicion != acts for finding in findings)
    assert not np.delete(lost(take), take.markers.index("RFHD"), axis=1).any()


@pytest.mark.parametrize("gap", [(140, 149), (152, 160)])
def test_an_excursion_beside_a_gap_is_a_suspicion(walk, gap):
    take = displaced(walk, "RFHD", 149, 152, [0.0, 0.0, 60.0])
    trusted = take.trusted.copy()
    trusted[slice(*gap), take.markers.index("RFHD")] = False
    take = replace(take, trusted=trusted)
    assert lost(take, "RFHD") == []
    assert detect(take).suspicious[149:152, take.markers.index("RFHD")].all()


@pytest.mark.parametrize(("rate", "acts"), [(30.0, False), (40.0, False), (50.0, True), (250.0, True)])
def test_below_50_hz_no_excursion_is_distrusted(rate, acts):
    take = displaced(perform("walk", 3.0, rate, 1).markers, "CLAV", 40, 41, [0.0, 150.0, 0.0])
    assert lost(take, "CLAV") == ([40] if acts else [])


@pytest.mark.parametrize("name", ["LFHD", "RWRA", "LANK"])
def test_a_leap_that_lasts_is_told_at_its_frame(walk, name):
    take = displaced(walk, name, 200, 400, [250.0, -200.0, 100.0])
    assert not lost(take).any()
    assert any(finding.level == "warning" and abs(finding.frames[0] - 200) <= 1 for finding in told(take, name))


def test_a_limb_that_leaps_is_told_at_its_frame(joints):
    positions = joints.positions.copy()
    arm = [joints.markers.index(name) for name in ("lhumerus", "lradius", "lhand")]
    positions[140:, arm] += [0.0, 320.0, 150.0]
    result = detect(replace(joints, positions=positions))
    assert result.trusted.all()
    at = {finding.marker for finding in result.findings if finding.frames == (139, 141) and finding.suspicion}
    assert at >= {"lradius", "lhand"}


@pytest.mark.parametrize(("replace_", "trusted"), [("sure", True), ("suspicious", False), ("missing", True)])
def test_the_choice_and_the_level_say_what_a_finding_does(walk, replace_, trusted):
    take = displaced(walk, "LTHI", 200, 400, [0.0, 25.0, 30.0])
    result = detect(take, replace=replace_)
    column = take.markers.index("LTHI")
    assert result.trusted[210:, column].all() == trusted
    assert result.distrusted_by("drift")[210:, column].all() != trusted
    assert result.suspicious[210:, column].all() == trusted


def test_a_level_makes_a_rule_act_or_report(walk):
    take = displaced(displaced(walk, "LTHI", 200, 400, [0.0, 25.0, 30.0]), "RFHD", 100, 101, [0.0, 0.0, 60.0])
    rules = {"drift": RULES["drift"].Params(replace="always"), "spike": RULES["spike"].Params(replace="never")}
    result = detect(take, rules)
    assert not result.trusted[210:, take.markers.index("LTHI")].any()
    assert result.trusted[100, take.markers.index("RFHD")]
    assert result.suspicious[100, take.markers.index("RFHD")]
    assert detect(take, rules, replace="missing").trusted.all()


def test_another_choice_is_refused(walk):
    with pytest.raises(UsageError, match="replace must be one of sure, suspicious, missing"):
        detect(walk, replace="all")


@pytest.mark.parametrize("motion", ["walk", "boxing"])
@pytest.mark.parametrize("names", [("RSHN", "RANK"), ("LBHD", "RBHD"), ("RTHI", "RFWT")])
@pytest.mark.parametrize("start", [180, 420])
def test_labels_exchanged_across_a_gap_are_a_swap(motion, names, start):
    take = perform(motion, 6.0, 100.0, 5).markers
    columns = [take.markers.index(name) for name in names]
    positions, trusted = take.positions.copy(), take.trusted.copy()
    positions[start:, columns] = positions[start:, columns[::-1]]
    trusted[start - 12 : start + 9, columns] = False
    broken = replace(take, positions=positions, trusted=trusted)
    shorter = (0, start - 12) if start < 300 else (start + 9, 600)
    rules = {name: module.Params() for name, module in RULES.items() if name != "missing"}
    found = {(finding.rule, finding.marker, finding.frames) for finding in detect(broken, rules).findings}
    assert found == {("swap", name, shorter) for name in names}
    assert not (trusted & ~detect(broken, rules).trusted).any()


def test_a_gap_of_two_markers_alone_is_no_swap(walk):
    trusted = walk.trusted.copy()
    trusted[150:240, [walk.markers.index(name) for name in ("LANK", "LTOE", "RWRA", "RWRB")]] = False
    assert not {finding.rule for finding in detect(replace(walk, trusted=trusted)).findings} - {"missing"}


def test_a_detached_column_is_judged_by_its_own_path_alone(rng, walk):
    time = np.arange(400)[:, None] / 100.0
    angle = [10.0, -5.0, 2.0] + 12.0 * np.sin(2 * np.pi * time * [0.6, 0.9, 0.4])
    detached = np.arange(len(walk.markers) + 1) == len(walk.markers)
    take = with_marker(walk, "ANGLE", angle, detached=detached)
    assert not told(take, "ANGLE")
    assert not np.isfinite(Evidence(take).rigid.spread[-1]).any()
    # Whatever a detached column holds, the findings about the others are the same.
    broken = displaced(take, "LTHI", 200, 400, [0.0, 25.0, 30.0])
    wild = broken.positions.copy()
    wild[:, -1] = rng.normal(scale=1e4, size=(400, 3))
    assert told(replace(broken, positions=wild), "LTHI") == told(broken, "LTHI") != []


@pytest.mark.parametrize("sentinel", [9999999.0, -1e6, 99999.0])
def test_a_sentinel_is_distrusted_and_its_neighbours_are_not(walk, sentinel):
    positions, column = walk.positions.copy(), walk.markers.index("RANK")
    positions[120:135, column] = sentinel
    positions[300, column, 1] = sentinel
    take = replace(walk, positions=positions)
    assert lost(take, "RANK") == [*range(120, 135), 300]
    assert lost(take).sum() == 16
    assert {finding.rule for finding in detect(take).findings} == {"units"}


def test_a_take_in_a_wrong_unit_keeps_its_samples(walk):
    assert not lost(replace(walk, positions=walk.positions * 1000.0)).any()
