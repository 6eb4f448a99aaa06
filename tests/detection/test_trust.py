"""Trust data detection and spans of the user: the properties that must hold."""

import re

import numpy as np
import pytest

from mocapclean.detection import RULES, detect
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rules import tdd
from mocapclean.detection.spans import distrust, read_spans
from mocapclean.errors import UsageError
from mocapclean.take import Take


def smooth_take(rng, n_frames=300, n_markers=12, rate=120.0):
    """Markers on slow sine paths, a metre apart at most, all trusted."""
    t = np.arange(n_frames)[:, None, None] / rate
    phase, speed = rng.uniform(0, 6, (1, n_markers, 3)), rng.uniform(0.3, 1.0, (1, n_markers, 3))
    positions = 300 * np.sin(2 * np.pi * speed * t + phase) + rng.uniform(-500, 500, (1, n_markers, 3))
    markers = tuple(f"M{k}" for k in range(n_markers))
    return Take(positions=positions, trusted=np.ones((n_frames, n_markers), bool), markers=markers, rate=rate)


def with_positions(take, positions, trusted=None):
    return Take(
        positions=positions, trusted=take.trusted if trusted is None else trusted, markers=take.markers, rate=take.rate
    )


def distrusted(take, **params):
    return tdd.examine(Evidence(take), tdd.Params(**params))[0]


def found(take, **params):
    return tdd.examine(Evidence(take), tdd.Params(**params))[1]


def faulty_take(rng):
    take = smooth_take(rng)
    positions = take.positions.copy()
    faults = np.zeros_like(take.trusted)
    for marker, start, length in [(0, 50, 1), (3, 120, 8), (3, 200, 1), (7, 20, 15), (11, 260, 3)]:
        positions[start : start + length, marker] += rng.normal(size=3) * 150 + 100
        faults[start : start + length, marker] = True
    return with_positions(take, positions), faults


def test_clean_motion_is_trusted(rng):
    assert not distrusted(smooth_take(rng)).any()


def test_spikes_and_bursts_are_found_and_nothing_else(rng):
    take, faults = faulty_take(rng)
    np.testing.assert_array_equal(distrusted(take), faults)


def test_a_single_spike_in_constant_motion_flags_just_that_frame(rng):
    take = smooth_take(rng)
    positions = np.cumsum(np.full_like(take.positions, 2.0), axis=0)
    positions[100, 4] += 61.0
    expected = np.zeros_like(take.trusted)
    expected[100, 4] = True
    np.testing.assert_array_equal(distrusted(with_positions(take, positions)), expected)


def test_time_reversal_gives_the_same_samples(rng):
    take, _ = faulty_take(rng)
    backwards = with_positions(take, take.positions[::-1])
    np.testing.assert_array_equal(distrusted(backwards)[::-1], distrusted(take))


def test_moving_the_world_changes_nothing(rng):
    take, faults = faulty_take(rng)
    walk = np.cumsum(rng.normal(size=(len(take.trusted), 1, 3)) * 10, axis=0)
    np.testing.assert_array_equal(distrusted(with_positions(take, take.positions + 5000.0)), faults)
    np.testing.assert_array_equal(distrusted(with_positions(take, take.positions + walk)), faults)


def test_an_endless_threshold_distrusts_nothing(rng):
    take, _ = faulty_take(rng)
    assert not distrusted(take, distance=1e9).any()


def test_the_threshold_scales_with_the_rate(rng):
    take = smooth_take(rng, rate=120.0)
    positions = take.positions.copy()
    positions[100:108, 2] += 50.0
    at = {rate: Take(positions=positions, trusted=take.trusted, markers=take.markers, rate=rate) for rate in (60, 240)}
    assert not found(at[60])
    assert {finding.marker for finding in found(at[240])} == {"M2"}


def test_missing_samples_are_never_read(rng):
    take, _ = faulty_take(rng)
    trusted = rng.random(take.trusted.shape) > 0.1
    low, high = (
        distrusted(with_positions(take, np.where(trusted[..., None], take.positions, junk), trusted))
        for junk in (np.nan, 1e9)
    )
    np.testing.assert_array_equal(low, high)
    assert not (low & ~trusted).any()


@pytest.mark.parametrize("n_frames", [1, 2, 3])
@pytest.mark.parametrize("n_markers", [1, 2])
def test_tiny_takes_are_answered(rng, n_frames, n_markers):
    take = smooth_take(rng, n_frames=n_frames, n_markers=n_markers)
    assert distrusted(take).shape == (n_frames, n_markers)


def test_pure_noise_ends_in_time_and_keeps_something(rng):
    take = smooth_take(rng, n_frames=2000, n_markers=3)
    noise = with_positions(take, rng.normal(size=take.positions.shape) * 1e4)
    assert not distrusted(noise).all(axis=0).any()


def test_detect_only_lowers_trust_and_names_every_sample(rng):
    take, faults = faulty_take(rng)
    take = with_positions(take, take.positions, np.arange(300)[:, None] % 97 > 3 + np.zeros((1, 12)))
    result = detect(take, replace="suspicious")
    assert not (result.trusted & ~take.trusted).any()
    named = np.zeros_like(result.trusted)
    for finding in result.findings:
        if finding.suspicion:  # A leap, of which nothing shows the wrong side.
            continue
        named[slice(*finding.frames), take.markers.index(finding.marker)] = True
    np.testing.assert_array_equal(named, ~result.trusted)
    assert faults[~result.trusted].any()


def test_detect_refuses_unknown_rules(rng):
    with pytest.raises(UsageError, match="must be one of missing"):
        detect(smooth_take(rng), {"magic": None})


def test_rules_have_documented_defaults():
    for name, module in RULES.items():
        assert module.__doc__, name
        module.Params()


def spans(tmp_path, text):
    path = tmp_path / "bad.csv"
    path.write_text(text, encoding="utf-8")
    return read_spans(path)


def test_spans_use_the_files_own_inclusive_numbers(rng, tmp_path):
    take = smooth_take(rng)
    take = Take(positions=take.positions, trusted=take.trusted, markers=take.markers, rate=take.rate, first_frame=11)
    got = distrust(take, spans(tmp_path, "marker,first,last\nM2,11,13\n\nM2,310,310\n"))
    np.testing.assert_array_equal(np.flatnonzero(~got.trusted[:, 2]), [0, 1, 2, 299])
    assert got.trusted.sum() == take.trusted.sum() - 4


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("M2,1\n", r"line 1: a span must be marker,first,last. Got 'M2,1'"),
        ("M2,a,b\n", "line 1: a span must be marker,first,last"),
        ("M2,5,4\n", "first frame must not come after its last"),
        ("M2,1,301\n", "line 1: frames must lie in the take's 1 to 300. Got 1 to 301"),
        ("marker,first,last\nM99,1,2\n", "line 2: the take has no marker 'M99'. Near: M9"),
    ],
)
def test_bad_spans_are_refused_with_their_line(rng, tmp_path, text, message):
    with pytest.raises(UsageError, match=message):
        distrust(smooth_take(rng), spans(tmp_path, text))


def test_a_missing_spans_file_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"none\.csv: cannot be read"):
        read_spans(tmp_path / "none.csv")


@pytest.mark.parametrize("longest", [1.0, 2.0])
def test_a_jump_between_two_long_segments_is_reported_and_neither_side_is_distrusted(rng, longest):
    take = smooth_take(rng, n_frames=400)
    positions = take.positions.copy()
    positions[200:, 5] += 90.0
    assert not distrusted(with_positions(take, positions)).any()


@pytest.mark.parametrize(("start", "stop"), [(0, 1), (0, 30), (60, 150), (149, 150)])
@pytest.mark.parametrize("offset", [130.0, 400.0])
def test_a_pose_at_an_end_of_the_take_is_left_and_its_leap_is_told(rng, start, stop, offset):
    take = smooth_take(rng, n_frames=150)
    positions = take.positions.copy()
    positions[start:stop, 5] += offset
    doubted, findings = tdd.examine(Evidence(with_positions(take, positions)), tdd.Params())
    assert not doubted.any()
    (finding,) = findings
    at = stop if start == 0 else start
    assert (finding.marker, finding.frames, finding.level) == ("M5", (at - 1, at + 1), "warning")
    assert finding.suspicion
    assert re.match(r"moves \d+ mm within one frame", finding.message)
