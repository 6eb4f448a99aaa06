"""Faults put into a take: what is said to be faulty is, by as much as is said, and nothing else is touched."""

import csv
import itertools

import numpy as np
import pytest
from click.testing import CliRunner

from mocapclean.cli import cli
from mocapclean.errors import UsageError
from mocapclean.formats import read
from mocapclean.simulate import FAULTS, inject, perform

SIZES = {"spike": 20.0, "jump": 40.0, "drift": 20.0}


@pytest.fixture(scope="module")
def walk():
    """Markers of five seconds of walking, all trusted."""
    return perform("walk", 5.0, 120.0, 3).markers


def put(take, *kinds, seed=0, **options):
    return inject(take, np.random.default_rng(seed), kinds, **options)


def of(injected, kind):
    return [event for event in injected.events if event.kind == kind]


def test_only_faulty_samples_differ_and_every_event_is_in_the_mask(walk):
    injected = put(walk, rate=3.0)
    assert {event.kind for event in injected.events} == set(FAULTS)
    same = (injected.take.positions == walk.positions).all(axis=2)
    assert same[~injected.faulty].all()
    named = np.zeros_like(injected.faulty)
    for event in injected.events:
        assert not (named & injected.samples(event)).any()
        named |= injected.samples(event)
    np.testing.assert_array_equal(named, injected.faulty)
    np.testing.assert_array_equal(injected.take.trusted, walk.trusted)


def test_the_seed_decides(walk):
    first, again, other = put(walk, seed=1), put(walk, seed=1), put(walk, seed=2)
    np.testing.assert_array_equal(first.take.positions, again.take.positions)
    assert first.events == again.events != other.events


@pytest.mark.parametrize("size", [1.0, 4.0])
@pytest.mark.parametrize("kind", SIZES)
def test_shifts_have_their_size(walk, kind, size):
    injected = put(walk, kind, rate=2.0, size=size)
    for event in of(injected, kind):
        away = np.linalg.norm((injected.take.positions - walk.positions)[injected.samples(event)], axis=1)
        assert away.max() == pytest.approx(SIZES[kind] * size)
        assert kind == "drift" or away.min() == pytest.approx(SIZES[kind] * size)


def test_a_drift_lasts_to_the_end_and_turns_with_the_segment(walk):
    (event,) = of(put(walk, "drift", rate=0.1), "drift")
    assert event.stop == len(walk.trusted)
    injected = put(walk, "drift", rate=0.1)
    offset = (injected.take.positions - walk.positions)[event.stop - 200 :, event.markers[0]]
    assert np.linalg.norm(offset, axis=1) == pytest.approx(20.0)
    assert np.abs(offset - offset[0]).max() > 0.1


def test_flicker_has_its_spread(walk):
    injected = put(walk, "flicker", rate=10.0)
    noise = np.concatenate(
        [(injected.take.positions - walk.positions)[injected.samples(e)] for e in of(injected, "flicker")]
    )
    assert noise.std() == pytest.approx(10.0, rel=0.1)


def test_frozen_markers_repeat_the_frame_before_while_the_true_one_leaves(walk):
    injected = put(walk, "frozen", rate=3.0)
    assert of(injected, "frozen")
    for event in of(injected, "frozen"):
        (marker,) = event.markers
        last = walk.positions[event.start - 1, marker]
        assert (injected.take.positions[event.start : event.stop, marker] == last).all()
        assert np.linalg.norm(walk.positions[event.start : event.stop, marker] - last, axis=1).max() >= 20.0


def test_swaps_exchange_markers_that_are_apart(walk):
    injected = put(walk, "swap", rate=3.0)
    for event in of(injected, "swap"):
        a, b = event.markers
        span = slice(event.start, event.stop)
        np.testing.assert_array_equal(injected.take.positions[span, a], walk.positions[span, b])
        np.testing.assert_array_equal(injected.take.positions[span, b], walk.positions[span, a])
        assert np.linalg.norm(walk.positions[span, a] - walk.positions[span, b], axis=1).min() >= 80.0


def test_events_keep_apart_and_untrusted_samples_stay(walk):
    rng = np.random.default_rng(5)
    trusted = rng.random(walk.trusted.shape) > 0.02
    take = walk.__class__(positions=walk.positions, trusted=trusted, markers=walk.markers, rate=walk.rate)
    injected = put(take, rate=2.0)
    assert not (injected.faulty & ~trusted).any()
    for marker in range(len(take.markers)):
        spans = sorted((e.start, e.stop) for e in injected.events if marker in e.markers)
        assert all(later[0] - earlier[1] >= 10 for earlier, later in itertools.pairwise(spans))


def test_no_rate_no_faults(walk):
    assert put(walk, rate=0.0).events == ()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kinds": ["magic"]}, "a fault must be one of drift.*Got 'magic'"),
        ({"rate": -1.0}, "The rate of faults"),
        ({"size": 0.0}, "The size of faults"),
    ],
)
def test_what_cannot_be_is_refused(walk, options, message):
    with pytest.raises(UsageError, match=message):
        inject(walk, np.random.default_rng(0), **options)


def test_simulate_writes_faults_and_lists_them(tmp_path):
    arguments = ["simulate", "--out-dir", tmp_path, "--motion", "walk", "--seconds", "3", "--missing", "0"]
    result = CliRunner().invoke(cli, [*map(str, arguments), "--faults", "spike,swap", "--fault-rate", "2"])
    assert result.exit_code == 0, result.output
    truth, faulty = read(tmp_path / "walk_truth.c3d"), read(tmp_path / "walk.c3d")
    with (tmp_path / "walk_faults.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["kind"] for row in rows} == {"spike", "swap"}
    named = np.zeros_like(truth.trusted)
    for row in rows:
        first, last = int(row["first"]) - truth.first_frame, int(row["last"]) - truth.first_frame
        named[first : last + 1, truth.markers.index(row["marker"])] = True
    np.testing.assert_array_equal((truth.positions != faulty.positions).any(axis=2), named)


def test_simulate_states_a_wrong_unit(tmp_path):
    arguments = ["simulate", "--out-dir", tmp_path, "--motion", "walk", "--seconds", "1", "--missing", "0"]
    assert CliRunner().invoke(cli, [*map(str, arguments), "--stated-as", "m"]).exit_code == 0
    truth, small = read(tmp_path / "walk_truth.c3d"), read(tmp_path / "walk.c3d")
    np.testing.assert_allclose(small.positions * 1000.0, truth.positions, rtol=1e-5, atol=1e-2)
