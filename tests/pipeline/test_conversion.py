"""Conversion: round trips between all formats of markers, and the account of what a new file does not have."""

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
import table_texts as texts

import mocapclean
from mocapclean import formats
from mocapclean.config.settings import Settings
from mocapclean.errors import UsageError
from mocapclean.formats.declarations import DECLARATIONS
from mocapclean.pipeline.conversion import convert

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"
MARKER_FORMATS = [name for name, facts in DECLARATIONS.items() if facts.columns == "markers"]
FLOAT32 = 2.0**-24
"""Relative error of a number that is rounded to 32 bits."""
TABLE_MM = 0.5e-6 + 1e-9
"""Millimetres: half a step of the sixth decimal, and rounding."""


@pytest.fixture(scope="module")
def starts(tmp_path_factory):
    """A take of the walk with gaps, as a file of each format of markers."""
    folder = tmp_path_factory.mktemp("starts")
    take = mocapclean.read(SAMPLES / "walk.c3d").crop(100, 160)
    paths = {}
    for name in MARKER_FORMATS:
        (folder / name).mkdir()
        paths[name] = folder / name / f"walk{DECLARATIONS[name].suffixes[0]}"
        mocapclean.write(take, paths[name], format=name)
    return paths


@pytest.mark.parametrize(("first", "second"), [*permutations(MARKER_FORMATS, 2)])
def test_a_round_trip_loses_nothing_that_both_can_hold(first, second, starts, tmp_path):
    start = starts[first]
    there = tmp_path / f"there{DECLARATIONS[second].suffixes[0]}"
    back = tmp_path / f"back{DECLARATIONS[first].suffixes[0]}"
    convert(start, there, Settings(), second)
    done = convert(there, back, Settings(), first)
    before, after = mocapclean.read(start), mocapclean.read(back)
    assert (after.markers, after.first_frame) == (before.markers, before.first_frame)
    assert after.rate == pytest.approx(before.rate, rel=1e-7)
    np.testing.assert_array_equal(after.trusted, before.trusted)
    rounding = np.abs(before.positions) * FLOAT32 + TABLE_MM
    assert (np.abs(after.positions - before.positions) <= 2 * rounding)[before.trusted].all()
    assert done.missing == (~before.trusted).sum()


def test_subjects_and_events_go_to_a_new_c3d(tmp_path):
    (tmp_path / "take.csv").write_bytes(texts.nexus())
    done = convert(tmp_path / "take.csv", tmp_path / "take.c3d", Settings())
    assert any("section Model Outputs" in text for text in done.not_carried)
    ezc3d = pytest.importorskip("ezc3d")
    parameters = ezc3d.c3d(str(tmp_path / "take.c3d"))["parameters"]
    assert parameters["SUBJECTS"]["NAMES"]["value"] == ["Ann"]
    assert parameters["SUBJECTS"]["LABEL_PREFIXES"]["value"] == ["Ann:"]
    assert parameters["POINT"]["UNITS"]["value"] == ["mm"]
    assert parameters["EVENT"]["LABELS"]["value"] == ["Foot Off", "Foot Strike"]


def test_a_skeleton_becomes_markers_at_its_joints(tmp_path):
    done = convert(SAMPLES / "walk.bvh", tmp_path / "walk.trc", Settings())
    assert "joint angles and the tree of joints" in done.not_carried
    take = mocapclean.read(SAMPLES / "walk.bvh")
    back = mocapclean.read(tmp_path / "walk.trc", points=take.markers)
    known = take.as_markers().trusted
    np.testing.assert_array_equal(back.trusted, known)
    np.testing.assert_allclose(back.positions[known], take.positions[known], atol=1e-6)


def test_what_is_not_carried_is_told(tmp_path):
    (tmp_path / "take.csv").write_bytes(texts.motive())
    lost = convert(tmp_path / "take.csv", tmp_path / "take.trc", Settings()).not_carried
    assert any(text.startswith("points that are no markers: 3") for text in lost)
    assert "other columns: 6" in lost
    (tmp_path / "take.tsv").write_bytes(texts.qualisys())
    lost = convert(tmp_path / "take.tsv", tmp_path / "2.trc", Settings()).not_carried
    assert "events: 1" in lost
    assert not any(
        "event" in text for text in convert(tmp_path / "take.tsv", tmp_path / "2.c3d", Settings()).not_carried
    )


def test_frame_numbers_that_c3d_has_not_are_told_and_events_stay_in_their_frames(tmp_path):
    (tmp_path / "take.tsv").write_bytes(texts.qualisys(first=0))
    done = convert(tmp_path / "take.tsv", tmp_path / "take.c3d", Settings())
    assert done.first_frame == 1
    assert "frame numbers from 0 on: the first frame is 1" in done.not_carried
    (event,) = formats.events(mocapclean.read(tmp_path / "take.c3d"))
    assert event.frame == pytest.approx(12.0, abs=1e-3)


def test_single_markers_can_be_converted(tmp_path):
    (tmp_path / "take.tsv").write_bytes(texts.qualisys())
    convert(tmp_path / "take.tsv", tmp_path / "take.c3d", Settings(markers=("?ANK",)))
    back = mocapclean.read(tmp_path / "take.c3d")
    assert back.markers == ("LANK", "RANK")
    assert len(formats.events(back)) == 1


def test_positions_do_not_become_a_skeleton(tmp_path):
    with pytest.raises(UsageError, match="positions alone are not a pose"):
        convert(SAMPLES / "walk.c3d", tmp_path / "walk.bvh", Settings())
    with pytest.raises(UsageError, match="must end in"):
        convert(SAMPLES / "walk.c3d", tmp_path / "walk.trc", Settings(), "csv")
    with pytest.raises(UsageError, match="must be one of"):
        convert(SAMPLES / "walk.c3d", tmp_path / "walk.trc", Settings(), "fbx")
