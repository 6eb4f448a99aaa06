"""BVH: reading, unchanged bytes and refusals, over real captures and made-up variants."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import capture_files
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from posed_takes import turned

from mocapclean.errors import FormatError, UsageError
from mocapclean.formats import bvh
from mocapclean.geometry.skeleton import Channel, Skeleton, forward
from mocapclean.take import ReadOptions, Take
from mocapclean.take.posed import posed_take, with_poses

FILES = capture_files("bvh")
TEXT = b"""HIERARCHY
ROOT Hips
{
\tOFFSET 1.0 90.0 0.0
\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
\tJOINT Left Leg
\t{
\t\tOFFSET 8.0 -4.0 0.0
\t\tCHANNELS 3 Yrotation Xrotation Zrotation
\t\tJOINT Left Foot
\t\t{
\t\t\tOFFSET 0.0 -40.0 1.0
\t\t\tCHANNELS 4 Xrotation Zposition Zrotation Yrotation
\t\t\tEnd Site
\t\t\t{
\t\t\t\tOFFSET 0.0 -40.0 8.0
\t\t\t}
\t\t}
\t}
\tJOINT Chest
\t{
\t\tOFFSET 0.0 20.0 0.0
\t\tCHANNELS 3 Zrotation Xrotation Yrotation
\t\tEnd Site
\t\t{
\t\t\tOFFSET 0.0 20.0 0.0
\t\t}
\t}
}
MOTION
Frames: 4
Frame Time: 0.0083333
1.00 90.00 0.00 1.50 -2.25 3.00\t 10.00 20.00 -30.00  5.00 1.00 -5.00 2.50  4.00 5.00 6.00
1.10 90.10 0.10 1.60 -2.35 3.10\t 11.00 21.00 -31.00  5.50 1.10 -5.50 2.60  4.10 5.10 6.10
1.20 90.20 0.20 1.70 -2.45 3.20\t 12.00 22.00 -32.00  6.00 1.20 -6.00 2.70  4.20 5.20 6.20
1.30 90.30 0.30 1.80 -2.55 3.30\t 13.00 23.00 -33.00  6.50 1.30 -6.50 2.80  4.30 5.30 6.30
"""
ORACLE = """
import sys, pathlib, numpy, bvhio
for path in sorted(pathlib.Path(sys.argv[1]).glob("*.bvh")):
    try:
        root = bvhio.readAsHierarchy(str(path))
    except Exception:
        continue
    frames = range(root.getKeyframeRange()[1] + 1)
    places = [[list(j.PositionWorld) for j, _, _ in root.loadPose(frame).layout()] for frame in frames]
    numpy.save(path.with_suffix(".npy"), places)
"""


@pytest.fixture
def small(tmp_path: Path) -> Path:
    return save(tmp_path, TEXT)


def save(folder: Path, text: bytes) -> Path:
    path = folder / "small.bvh"
    path.write_bytes(text)
    return path


def load(path: Path, **options: float) -> Take:
    return bvh.read(path, ReadOptions(**options))


def refused(folder: Path, old: bytes, new: bytes) -> FormatError:
    """Return the error for the small file with its first ``old`` replaced."""
    assert old in TEXT
    with pytest.raises(FormatError) as caught:
        load(save(folder, TEXT.replace(old, new, 1)))
    return caught.value


def test_small_file_as_written(small: Path) -> None:
    take = load(small)
    assert take.markers == ("Hips", "Left Leg", "Left Foot", "Chest")
    assert take.rate == 1 / 0.0083333
    assert take.first_frame == 1
    assert [finding.rule for finding in take.findings] == ["units"]
    np.testing.assert_allclose(take.positions[:, 0, 1], [900, 901, 902, 903])
    assert take.trusted.all()
    bones = {(bone.start, bone.end): bone.length for bone in take.skeleton.bones()}
    assert bones == pytest.approx({("Hips", "Left Leg"): 80**0.5 * 10, ("Hips", "Chest"): 200.0})


def test_rotations_multiply_as_listed_and_positions_replace_offsets(small: Path) -> None:
    def rotation(order: str, angles: list[float]) -> np.ndarray:
        product = np.eye(3)
        for letter, angle in zip(order, np.radians(angles), strict=True):
            c, s = np.cos(angle), np.sin(angle)
            matrix = {
                "X": [[1, 0, 0], [0, c, -s], [0, s, c]],
                "Y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
                "Z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
            }[letter]
            product = product @ np.array(matrix)
        return product

    hips = rotation("ZXY", [1.5, -2.25, 3.0])
    knee = np.array([1.0, 90.0, 0.0]) + hips @ [8.0, -4.0, 0.0]
    foot = knee + hips @ rotation("YXZ", [10.0, 20.0, -30.0]) @ [0.0, -40.0, 1.0]
    np.testing.assert_allclose(load(small).positions[0, 1:3], 10 * np.array([knee, foot]), atol=1e-9)


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_capture_comes_back_identical(path: Path, tmp_path: Path) -> None:
    take = load(path)
    assert take.trusted.all()
    written = bvh.write(take, tmp_path / "out.bvh")
    assert (tmp_path / "out.bvh").read_bytes() == path.read_bytes()
    bvh.prove(written, tmp_path / "out.bvh")


def test_captures_agree_with_bvhio(captures: Path, tmp_path: Path) -> None:
    """The first frames of every capture, against an independent reader in a process that may hang or die."""
    for path in FILES:
        head, word, rows = path.read_bytes().partition(b"Frame Time:")
        lines = rows.splitlines(keepends=True)[:4]
        head = re.sub(rb"Frames:\s*\d+", b"Frames: %d" % (len(lines) - 1), head)
        (tmp_path / path.name).write_bytes(head + word + b"".join(lines))
    subprocess.run([sys.executable, "-c", ORACLE, str(tmp_path)], timeout=60, check=True, capture_output=True)
    compared = [np.load(path) for path in sorted(tmp_path.glob("*.npy"))]
    assert len(compared) >= 30
    for path, expected in zip(sorted(tmp_path.glob("*.npy")), compared, strict=True):
        found = load(path.with_suffix(".bvh"), unit=1.0).positions[: len(expected)]
        np.testing.assert_allclose(found, expected, atol=4e-4 + 2e-6 * np.abs(expected).max(), rtol=0)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"\n", b"\r\n"),
        (b"\n", b"\r"),
        (b"HIERARCHY", b"\xef\xbb\xbfHIERARCHY"),
        (b"Frames: 4", b"Frames:4"),
        (b"Frame Time: ", b"frame time:\t"),
        (b"\t", b"    "),
        (b" ", b"\t"),
        (b"MOTION\n", b"MOTION\n\n"),
        (b"1.50 ", b"1.5e+000 "),
        (b"1.50 ", b"+01.50 "),
        (b"JOINT", b"joint"),
        (b"\n\t{", b" {"),
        (b"6.30\n", b"6.30"),
    ],
)
def test_spellings_mean_the_same(tmp_path: Path, small: Path, old: bytes, new: bytes) -> None:
    expected = load(small)
    text = TEXT.replace(b"Left Leg", b"Leg").replace(b"Left Foot", b"Foot").replace(old, new)
    take = load(save(tmp_path, text))
    np.testing.assert_array_equal(take.positions, expected.positions)
    assert take.rate == expected.rate
    assert bvh.sniff(text[:512])
    bvh.write(take, tmp_path / "out.bvh")
    assert (tmp_path / "out.bvh").read_bytes() == text


def test_names_latin_1_repeated_and_with_spaces(tmp_path: Path) -> None:
    text = TEXT.replace(b"JOINT Chest", b"JOINT Left Leg").replace(b"Hips", b"H\xfcfte")
    take = load(save(tmp_path, text))
    assert take.markers == ("Hüfte", "Left Leg", "Left Foot", "Left Leg#2")
    bvh.write(take, tmp_path / "out.bvh")
    assert (tmp_path / "out.bvh").read_bytes() == text


def test_nan_is_a_missing_channel_of_its_joint_alone(tmp_path: Path) -> None:
    take = load(save(tmp_path, TEXT.replace(b"10.00 ", b"nan ").replace(b" -2.35 ", b" NaN ")))
    trusted = [[True, False, True, True], [False, True, True, True], [True] * 4, [True] * 4]
    assert take.trusted.tolist() == trusted
    assert (~take.known).sum() == 2
    # What hangs on a missing channel is no marker that is known.
    hidden = [[True, True, False, True], [True, False, False, False], [True] * 4, [True] * 4]
    assert take.as_markers().trusted.tolist() == hidden
    assert np.isfinite(take.positions).all()


def test_unit_and_rate(tmp_path: Path, small: Path) -> None:
    np.testing.assert_allclose(load(small, unit=25.4).positions, load(small).positions * 2.54)
    with pytest.raises(UsageError, match="unit must be positive"):
        load(small, unit=0.0)
    assert load(small, rate=50.0).rate == 1 / 0.0083333
    for word in (b"nan", b"0", b"-0.01", b"fast", b"1e-320"):
        bad = TEXT.replace(b"0.0083333", word)
        assert load(save(tmp_path, bad), rate=50.0).rate == 50.0
        with pytest.raises(FormatError, match="line 32: Frame Time: must be a positive number"):
            load(save(tmp_path, bad))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b" 6.10\n", b"\n", "line 34: a row of motion must have 16 numbers. Got 15"),
        (b" 6.10\n", b" 6.10 1\n", "line 34: a row of motion must have 16 numbers. Got 17"),
        (b" 6.10\n", b" 6,10\n", "line 34: a number must be decimal and at most 1e\\+09. Got '6,10'"),
        (b" 6.10\n", b" 6_1\n", "line 34: a number must be decimal"),
        (b" 6.10\n", b" 1e10\n", "line 34: a number must be decimal"),
        (b" 6.10\n", b" 1e400\n", "line 34: a number must be decimal"),
        (b"Frames: 4", b"Frames: 5", "must have 5 rows, as Frames: declares. Got 4; the file may be cut off"),
        (b"Frames: 4", b"Frames: 3", "must have 3 rows, as Frames: declares. Got 4; correct the count"),
        (b"Frames: 4", b"Frames: 999999999", "must have 999999999 rows"),
        (b"Frames: 4", b"Frames: 0", "line 31: Frames: must be a whole number from 1. Got '0'"),
        (b"Frames: 4", b"Frames: -4", "line 31: Frames: must be a whole number"),
        (b"Frames: 4", b"Frames: " + b"9" * 5000, "line 31: Frames: must be a whole number"),
        (b"Frame Time:", b"Time:", "line 31: Frame Time: and a number must follow"),
        (b"MOTION", b"NOTION", "must have a MOTION section"),
        (b"3 Yrotation", b"4 Yrotation", "line 9: CHANNELS must give the number of its names, 3. Got '4'"),
        (b"3 Yrotation", b"99999999999 Yrotation", "line 9: CHANNELS must give the number"),
        (b"3 Yrotation", b"3 Wrotation", "line 9: a channel must be .* Got 'Wrotation'"),
        (b"Yposition", b"Xposition", "line 5: a joint must have one position channel per axis"),
        (b"CHANNELS 3 Y", b"CHANELS 3 Y", "line 9: a statement must be a word of BVH. Got 'CHANELS'"),
        (b"OFFSET 8.0 -4.0 0.0", b"OFFSET 8.0 -4.0", "line 8: OFFSET must be 3 finite"),
        (b"OFFSET 8.0 -4.0 0.0", b"OFFSET 8.0 nan 0.0", "line 8: OFFSET must be 3 finite"),
        (b"\t\tOFFSET 8.0 -4.0 0.0\n", b"", "joint 'Left Leg' must have an OFFSET"),
        (b"JOINT Chest\n\t{", b"JOINT Chest\n", "a brace must open after a joint's name"),
        (b"JOINT Chest", b"JOINT ", "line 20: JOINT must be followed by a name"),
        (b"JOINT Chest", b"ROOT Chest", "line 20: a ROOT must stand outside"),
        (b"ROOT", b"JOINT", "line 2: a ROOT must stand outside of joints, a JOINT inside"),
        (b"}\nMOTION", b"\nMOTION", "every joint must be closed by a brace"),
        (b"}\nMOTION", b"}\n}\nMOTION", "line 30: a brace must close an open one"),
        (TEXT[: TEXT.index(b"MOTION")], b"HIERARCHY\n", "every joint must be closed"),
        (TEXT, b" \n", "must not be empty"),
        (TEXT, b"\x00\xff" * 300, "must have a MOTION section"),
    ],
)
def test_bad_input_is_one_clear_sentence(tmp_path: Path, old: bytes, new: bytes, message: str) -> None:
    error = refused(tmp_path, old, new)
    assert re.search(message, str(error))
    assert str(error).startswith(str(tmp_path / "small.bvh"))


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="No such file"):
        load(tmp_path / "none.bvh")


def test_deep_nesting_and_long_lines(tmp_path: Path) -> None:
    depth = 3000
    joint = b"JOINT a\n{\nOFFSET 0 1 0\nCHANNELS 1 Zrotation\n"
    tree = b"HIERARCHY\nROOT a\n{\nOFFSET 0 1 0\nCHANNELS 1 Zrotation\n" + joint * depth + b"}" * (depth + 1)
    text = tree + b"\nMOTION\nFrames: 1\nFrame Time: 0.01\n" + b"0 " * (depth + 1) + b"\n"
    take = load(save(tmp_path, text))
    np.testing.assert_allclose(take.positions[0, -1], [0, 10 * (depth + 1), 0])
    with pytest.raises(FormatError, match="must have 3001 numbers"):
        load(save(tmp_path, text + b" " * 1_000_000 + b"1 " * 100_000))


def test_cut_files_are_refused(tmp_path: Path) -> None:
    last = len(TEXT) - len(b"6.30\n") + 1  # from here on only the last number is cut, which nothing can tell
    for size in range(last):
        with pytest.raises(FormatError):
            load(save(tmp_path, TEXT[:size]))
    for size in range(last, len(TEXT)):
        assert load(save(tmp_path, TEXT[:size])).positions.shape == (4, 4, 3)


@settings(max_examples=2000, deadline=None, suppress_health_check=list(HealthCheck), database=None)
@given(st.lists(st.tuples(st.integers(0, len(TEXT) - 1), st.integers(0, 255)), min_size=1, max_size=4))
def test_flipped_bytes_read_or_are_refused(tmp_path: Path, flips: list[tuple[int, int]]) -> None:
    text = bytearray(TEXT)
    for at, byte in flips:
        text[at] = byte
    path = save(tmp_path, bytes(text))
    try:
        take = load(path)
    except FormatError:
        return
    assert np.isfinite(take.positions[take.trusted]).all()
    bvh.write(take, tmp_path / "out.bvh")
    assert (tmp_path / "out.bvh").read_bytes() == bytes(text)


def test_filled_joint_changes_only_its_numbers(tmp_path: Path, small: Path) -> None:
    take = turned(load(small), "Left Foot", slice(1, 3), 6.0)
    out = tmp_path / "out.bvh"
    written = bvh.write(take, out)
    bvh.prove(written, out)
    np.testing.assert_array_equal(written.filled, take.filled)
    old, new = TEXT.splitlines(keepends=True), out.read_bytes().splitlines(keepends=True)
    assert [i for i, pair in enumerate(zip(old, new, strict=True)) if pair[0] != pair[1]] == [33, 34]
    for i in (33, 34):
        assert re.split(rb"\S+", old[i]) == re.split(rb"\S+", new[i])
        assert old[i].split()[:9] == new[i].split()[:9]
        assert old[i].split()[13:] == new[i].split()[13:]
    again = load(out)
    np.testing.assert_allclose(again.positions, written.positions, atol=1e-6)
    np.testing.assert_allclose(again.poses, take.poses, atol=1e-6)


def test_missing_channels_are_filled_and_other_nan_stay(tmp_path: Path, small: Path) -> None:
    truth = load(small)
    path = save(
        tmp_path, TEXT.replace(b"12.00 22.00 -32.00", b"nan nan nan").replace(b"4.10 5.10 6.10", b"nan 5.10 6.10")
    )
    take = load(path)
    leg = take.markers.index("Left Leg")
    assert not take.trusted[2, leg]
    filled, poses = take.filled.copy(), take.poses.copy()
    filled[2, leg], poses[2] = True, truth.poses[2]
    out = tmp_path / "out.bvh"
    written = bvh.write(replace(with_poses(take, poses), filled=filled), out)
    bvh.prove(written, out)
    np.testing.assert_allclose(load(out).poses[2], truth.poses[2], atol=1e-6)
    assert out.read_bytes().count(b"nan") == 1


def test_proof_sees_any_other_difference(tmp_path: Path, small: Path) -> None:
    take = turned(load(small), "Left Foot", slice(1, 3), 6.0)
    out = tmp_path / "out.bvh"
    written = bvh.write(take, out)
    good = out.read_bytes()
    for old, new in [
        (b"Hips", b"Hops"),
        (b"1.00 90.00", b"1.000 90.00"),
        (b"1.10 90.10", b"1.10  90.10"),
        (b"1.10 90.10", b"1.20 90.10"),
        (b"6.30\n", b"6.30"),
    ]:
        assert good.count(old) == 1
        out.write_bytes(good.replace(old, new))
        with pytest.raises(FormatError, match="must"):
            bvh.prove(written, out)


def test_proof_sees_every_byte_that_is_changed_added_or_lost(tmp_path: Path, small: Path) -> None:
    take = turned(load(small), "Left Foot", slice(1, 3), 6.0)
    out = tmp_path / "out.bvh"
    written = bvh.write(take, out)
    good = out.read_bytes()
    rows = good.splitlines(keepends=True)
    repaired = range(len(b"".join(rows[:33])), len(b"".join(rows[:35])))
    for at in range(len(good) + 1):
        faults = [good[:at] + b"8" + good[at:], good[:at] + b" " + good[at:]]
        faults += [good[:at] + good[at + 1 :], good[:at] + b"~" + good[at + 1 :]] if at < len(good) else []
        for fault in faults:
            out.write_bytes(fault)
            try:
                bvh.prove(written, out)
            except FormatError:
                continue
            # Numbers of repaired frames may be spelled differently, if they are the same.
            assert at in repaired
            np.testing.assert_allclose(load(out).poses, written.poses, atol=1e-9)


def test_new_file_reads_back(tmp_path: Path, rng: np.random.Generator) -> None:
    channels = [Channel(joint=0, axis=axis, is_rotation=False) for axis in (0, 1, 2)]
    channels += [Channel(joint=joint, axis=axis, is_rotation=True) for joint in (0, 1, 2) for axis in (2, 0, 1)]
    skeleton = Skeleton(
        names=("Hips", "Left Leg", "Foot"),
        parents=(-1, 0, 1),
        before=np.array([[0, 0, 0], [100.0, 30.0, 5.0], [0.0, -432.1, 10.0]]),
        after=np.zeros((3, 3)),
        frames=np.broadcast_to(np.eye(3), (3, 3, 3)),
        channels=tuple(channels),
        product=(3, 5, 4, 6, 7, 8, 11, 10, 9),
    )
    angles = rng.uniform(-170, 170, (5, 12))
    angles[2, 7] = np.nan
    path = tmp_path / "new.bvh"
    bvh.create(posed_take(skeleton, angles, 120.0), path)
    take = load(path)
    assert take.markers == skeleton.names
    assert take.rate == pytest.approx(120.0, rel=1e-12)
    known = np.isfinite(forward(skeleton, angles)[0]).all(axis=2)
    np.testing.assert_array_equal(take.as_markers().trusted, known)
    np.testing.assert_allclose(take.positions[known], forward(skeleton, angles)[0][known], atol=1e-3)
    assert b"nan" in path.read_bytes()


def test_skeleton_alone(small: Path) -> None:
    skeleton = bvh.read_skeleton(small, 1.0)
    assert skeleton.names == ("Hips", "Left Leg", "Left Foot", "Chest")
    assert skeleton.bones()[1].length == pytest.approx(20.0)
    small.write_bytes(TEXT[: TEXT.index(b"MOTION")])
    assert bvh.read_skeleton(small).bones()[1].length == pytest.approx(200.0)
