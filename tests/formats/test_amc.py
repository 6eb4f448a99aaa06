"""AMC and ASF: reading, unchanged bytes and refusals, over real captures and made-up variants."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import capture_files
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from posed_takes import turned

from mocapclean.errors import FormatError
from mocapclean.formats import amc, asf, write
from mocapclean.formats.skeleton_files import find_skeleton
from mocapclean.geometry.skeleton import forward
from mocapclean.take import ReadOptions, Take
from mocapclean.take.posed import posed_take, with_poses

FILES = capture_files("amc")
ASF = b"""# a made-up skeleton
:version 1.10
:name VICON
:units
  mass 1.0
  length 0.45
  angle deg
:documentation
   made up for a test
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
     id 1
     name hip
     direction 0.6 -0.8 0
     length 2.5
     axis 0 0 0  XYZ
  end
  begin
     id 2
     name femur
     direction 0.34202 -0.939693 0
     length 7.0
     axis 10 -5 20  XYZ
    dof rx ry rz
    limits (-160.0 20.0)
           (-70.0 70.0)
           (-60.0 70.0)
  end
  begin
     id 3
     name tibia
     direction 0.34202 -0.939693 0
     length 7.5
     axis 0 0 20   XYZ
    dof rx rz
    limits (-10.0 170.0)
           (-70.0 20.0)
  end
  begin
     id 4
     name chest
     direction 0 1 0
     length 2.0
     axis 0 0 0   XYZ
    dof rx ry rz
  end
:hierarchy
  begin
    root hip chest
    hip femur
    femur tibia
  end
"""
TEXT = b"""#!OML:ASF F:\\VICON\\USERDATA\\rory3.ASF
:FULLY-SPECIFIED
:DEGREES
1
root 9.5 17.25 -14.1142 3.52634 -37.477 -5.55485
femur -1.05 2.25 30.125
tibia 20.5 -7.62852e-016
chest 1.5 2.5 3.5
2
root 9.6 17.35 -14.2142 3.62634 -37.577 -5.65485
femur -1.15 2.35 31.125
tibia 21.5 -1.25
chest 1.6 2.6 3.6
3
root 9.7 17.45 -14.3142 3.72634 -37.677 -5.75485
femur -1.25 2.45 32.125
tibia 22.5 -2.25
chest 1.7 2.7 3.7
4
root 9.8 17.55 -14.4142 3.82634 -37.777 -5.85485
femur -1.35 2.55 33.125
tibia 23.5 -3.25
chest 1.8 2.8 3.8
"""
UNIT = 25.4 / 0.45


@pytest.fixture
def small(tmp_path: Path) -> Path:
    return save(tmp_path)


def save(folder: Path, text: bytes = TEXT, asf: bytes = ASF) -> Path:
    (folder / "05.asf").write_bytes(asf)
    path = folder / "05_13.amc"
    path.write_bytes(text)
    return path


def load(path: Path) -> Take:
    return amc.read(path, ReadOptions())


def axis_turn(axis: int, degrees: float) -> np.ndarray:
    """A rotation about a coordinate axis, by Rodrigues' formula."""
    k = np.zeros((3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    k[j, i], k[i, j] = 1, -1
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def reference(path: Path, asf: Path, frame: int) -> dict[str, np.ndarray]:
    """Joint positions of one frame in millimetres: a plain reading of the two texts, joint by joint."""
    text = asf.read_text()
    bones = {}
    for block in re.findall(r"begin\s+id(.*?)end", text, re.DOTALL):
        field = {line.split()[0]: line.split()[1:] for line in ("id" + block).splitlines() if line.split()}
        c = np.eye(3)
        for axis in range(3):
            c = axis_turn(axis, float(field["axis"][axis])) @ c
        arm = np.array(field["direction"], dtype=float) * float(field["length"][0])
        bones[field["name"][0]] = (c, arm, field.get("dof", []))
    tree = [line.split() for line in text.split(":hierarchy")[1].splitlines() if len(line.split()) > 1]
    rows = path.read_text().split(":DEGREES")[1].split("\n")
    starts = [i for i, row in enumerate(rows) if row.strip().isdigit()]
    block = rows[starts[frame] + 1 : [*starts, len(rows)][frame + 1]]
    pose = {row.split()[0]: [float(v) for v in row.split()[1:]] for row in block if row.strip()}
    x, y, z, *angles = pose["root"]
    places = {"root": np.array([x, y, z])}
    turned = {"root": axis_turn(2, angles[2]) @ axis_turn(1, angles[1]) @ axis_turn(0, angles[0])}

    def hang(parent: str) -> None:
        for child in next((row[1:] for row in tree if row[0] == parent), []):
            c, arm, dof = bones[child]
            local = np.eye(3)
            for name, angle in zip(dof, pose.get(child, []), strict=True):
                local = axis_turn("xyz".index(name[1]), angle) @ local
            turned[child] = turned[parent] @ c @ local @ np.linalg.inv(c)
            places[child] = places[parent] + turned[child] @ arm
            hang(child)

    hang("root")
    return {name: place * UNIT for name, place in places.items()}


def test_small_file_as_written(small: Path) -> None:
    take = load(small)
    assert take.markers == ("root", "hip", "femur", "tibia", "chest")
    assert take.rate == 120.0
    assert [finding.rule for finding in take.findings] == ["rate"]
    assert amc.read(small, ReadOptions(rate=60.0)).rate == 60.0
    assert take.trusted.all()
    np.testing.assert_allclose(
        take.positions[:, 0] / UNIT,
        np.array([[9.5, 17.25, -14.1142]]) + 0.1 * np.array([[0], [1], [2], [3]]) * [1, 1, -1],
    )
    lengths = {bone.end: bone.length / UNIT for bone in take.skeleton.bones()}
    assert lengths == pytest.approx({"hip": 2.5, "femur": 7.0, "tibia": 7.5, "chest": 2.0})


@pytest.mark.parametrize("frame", [0, 3])
def test_small_file_agrees_with_a_plain_reading(small: Path, frame: int) -> None:
    take = load(small)
    expected = reference(small, small.parent / "05.asf", frame)
    np.testing.assert_allclose(take.positions[frame], [expected[name] for name in take.markers], atol=1e-3)


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_capture_comes_back_identical_and_is_right(path: Path, tmp_path: Path) -> None:
    take = load(path)
    written = amc.write(take, tmp_path / "out.amc")
    assert (tmp_path / "out.amc").read_bytes() == path.read_bytes()
    amc.prove(written, tmp_path / "out.amc")
    assert take.trusted.all()
    assert len(take.markers) == 31
    asf = path.with_name(path.name.partition("_")[0] + ".asf")
    for frame in (0, len(take.positions) - 1):
        expected = reference(path, asf, frame)
        np.testing.assert_allclose(take.positions[frame], [expected[name] for name in take.markers], atol=1e-2)
    lengths = dict(re.findall(r"name (\w+)\s+direction .*\s+length (\S+)", asf.read_text()))
    bones = take.skeleton.bones()
    assert len(bones) == 30
    for bone in bones:
        assert bone.length == pytest.approx(float(lengths[bone.end]) * UNIT, rel=1e-9)
        ends = take.positions[:, [take.markers.index(bone.start), take.markers.index(bone.end)]]
        np.testing.assert_allclose(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), bone.length, rtol=1e-9)


def test_radians_and_units_mean_the_same_motion(tmp_path: Path, small: Path) -> None:
    expected = load(small).positions

    def respelled(row: re.Match[bytes]) -> bytes:
        values = [float(value) for value in row[2].split()]
        moves = [value * 2 for value in values[:-3]] if row[1] == b"root" else []
        return row[1] + b"".join(b" %.12f" % v for v in [*moves, *np.radians(values[len(moves) :])])

    text = re.sub(rb"(?m)^([a-z]+)((?: \S+)+)$", respelled, TEXT)
    asf = re.sub(rb"length (2.5|7.0|7.5|2.0)", lambda m: b"length %.1f" % (float(m[1]) * 2), ASF)
    asf = asf.replace(b"length 0.45", b"length 0.90")
    np.testing.assert_allclose(
        load(save(tmp_path, text.replace(b":DEGREES", b":RADIANS"), asf)).positions, expected, atol=1e-6
    )
    in_radians = re.sub(
        rb"axis (\S+ \S+ \S+) ",
        lambda m: b"axis %.15f %.15f %.15f " % tuple(np.radians([float(v) for v in m[1].split()])),
        asf,
    ).replace(b"angle deg", b"angle rad")
    np.testing.assert_allclose(
        load(save(tmp_path, text.replace(b":DEGREES\n", b""), in_radians)).positions, expected, atol=1e-6
    )


def test_orders_of_root_and_dof(tmp_path: Path, small: Path) -> None:
    expected = load(small).positions
    swapped = re.sub(rb"root (\S+) (\S+) (\S+) (\S+) (\S+) (\S+)", rb"root \4 \3 \5 \2 \6 \1", TEXT)
    asf = ASF.replace(b"TX TY TZ RX RY RZ", b"rx tz ry ty rz tx")
    np.testing.assert_array_equal(load(save(tmp_path, swapped, asf)).positions, expected)

    other = load(save(tmp_path, TEXT, ASF.replace(b"RX RY RZ", b"RZ RY RX"))).positions[0]
    a, b, c = 3.52634, -37.477, -5.55485
    root = axis_turn(0, c) @ axis_turn(1, b) @ axis_turn(2, a)
    np.testing.assert_allclose(other[1] - other[0], root @ [1.5, -2.0, 0.0] * UNIT, atol=1e-9)

    shuffled = TEXT.replace(b"tibia 21.5 -1.25\nchest 1.6 2.6 3.6\n", b"chest 1.6 2.6 3.6\n\ntibia 21.5 -1.25\n")
    take = load(save(tmp_path, shuffled))
    np.testing.assert_array_equal(take.positions, expected)
    check_repair(take, tmp_path, shuffled, "tibia", {b"2"})


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"\n", b"\r\n"),
        (b"\n", b"\r"),
        (b" ", b"\t "),
        (b"\n2\n", b"\n\n 2 \n# a comment, with 3\n"),
        (b"#!OML", b"\xef\xbb\xbf#!OML"),
        (b"20.5 ", b"+2.05e+001 "),
        (b"3.8\n", b"3.8"),
    ],
)
def test_spellings_mean_the_same(tmp_path: Path, small: Path, old: bytes, new: bytes) -> None:
    expected = load(small)
    text = TEXT.replace(old, new)
    take = load(save(tmp_path, text, ASF.replace(old, new)))
    np.testing.assert_array_equal(take.positions, expected.positions)
    assert amc.sniff(text[:512])
    amc.write(take, tmp_path / "out.amc")
    assert (tmp_path / "out.amc").read_bytes() == text


def test_frames_may_start_anywhere(tmp_path: Path) -> None:
    text = re.sub(rb"(?m)^\d$", lambda m: b"%d" % (int(m[0]) + 98), TEXT)
    assert load(save(tmp_path, text)).first_frame == 99


def test_nan_is_a_missing_channel_of_its_bone_alone(tmp_path: Path) -> None:
    take = load(save(tmp_path, TEXT.replace(b"femur -1.05", b"femur nan").replace(b"-37.577", b"NaN")))
    assert (~take.known).sum() == 2
    assert (~take.trusted).sum() == 2
    expected = [[True, True, False, False, True], [True, *[False] * 4], [True] * 5, [True] * 5]
    assert take.as_markers().trusted.tolist() == expected


def test_skeleton_is_found_beside_the_file(tmp_path: Path) -> None:
    path = save(tmp_path)
    asf = tmp_path / "05.asf"
    for name in ("05_13.asf", "05.ASF", "anything.asf"):
        asf = asf.rename(tmp_path / name)
        assert find_skeleton(path, ".asf") == asf
        told = [finding.message for finding in load(path).findings if finding.rule == "skeleton"]
        guessed = "no .asf has the name of the take; anything.asf is taken, the only one in the folder"
        assert told == ([guessed] if name == "anything.asf" else [])
    (tmp_path / "other.asf").write_bytes(ASF)
    with pytest.raises(FormatError, match=r"skeleton \(\.asf\) must lie beside it\. Got 2 others"):
        load(path)
    assert amc.read(path, ReadOptions(skeleton=asf)).markers[0] == "root"
    with pytest.raises(FormatError, match=r"none\.asf: the file must be readable"):
        amc.read(path, ReadOptions(skeleton=tmp_path / "none.asf"))
    for file in tmp_path.glob("*.asf"):
        file.unlink()
    with pytest.raises(FormatError, match="Got 0 others"):
        load(path)


def test_skeleton_alone_is_no_take(tmp_path: Path, small: Path) -> None:
    with pytest.raises(FormatError, match=r"must be a take\. Got a skeleton"):
        load(tmp_path / "05.asf")
    with pytest.raises(FormatError, match=r"must be a take\. Got a skeleton"):
        load(save(tmp_path, ASF))
    skeleton = asf.read_skeleton(tmp_path / "05.asf")
    assert [bone.end for bone in skeleton.bones()] == ["hip", "femur", "tibia", "chest"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"tibia 21.5 -1.25", b"tibia 21.5", "line 12: 'tibia' must have 2 numbers, as in 05.asf. Got 1"),
        (b"tibia 21.5 -1.25", b"tibia 21.5 -1.25 0", "line 12: 'tibia' must have 2 numbers"),
        (b"tibia 21.5 -1.25\n", b"", "line 9: a frame must have all 4 bones that turn in 05.asf. Got none of 'tibia'"),
        (b"tibia 21.5", b"shin 21.5", "line 12: a bone must be one that turns in 05.asf. Got 'shin'"),
        (b"tibia 21.5 -1.25", b"chest 1 2 3", "line 13: a frame must have each bone once. Got 'chest' again"),
        (b"21.5", b"x", "line 12: a number must be decimal .* Got 'x'"),
        (b"21.5", b"2_1", "line 12: a number must be decimal"),
        (b"21.5", b"1e10", "line 12: a number must be decimal"),
        (b"\n3\n", b"\n5\n", "line 14: frame numbers must be consecutive, here 3. Got '5'"),
        (b"\n3\n", b"\n" + b"3" * 5000 + b"\n", "line 14: frame numbers must be consecutive"),
        (b"\n1\n", b"\n" + b"3" * 5000 + b"\n", "line 4: frame numbers must be consecutive"),
        (TEXT[TEXT.index(b"\n1\n") :], b"\n", "must have frames, each under its number"),
        (b":DEGREES", b"DEGREES", "line 3: a line before the first frame must be a comment or begin with a colon"),
        (TEXT, b"  \n", "must not be empty"),
    ],
)
def test_bad_motion_is_one_clear_sentence(tmp_path: Path, old: bytes, new: bytes, message: str) -> None:
    assert old in TEXT
    with pytest.raises(FormatError) as caught:
        load(save(tmp_path, TEXT.replace(old, new, 1)))
    assert re.search(message, str(caught.value))
    assert str(caught.value).startswith(str(tmp_path / "05_13.amc"))


def test_cut_motion_is_refused(tmp_path: Path) -> None:
    frame_ends = {match.start() + 1 for match in re.finditer(rb"(?m)(?<=\.[5-8])\n(?=\d\n|\Z)", TEXT)}
    for size in range(len(TEXT)):
        path = save(tmp_path, TEXT[:size])
        if {size, size + 1, size + 2, size + 3} & frame_ends:  # whole frames, or cut in a frame's last number
            load(path)
        else:
            with pytest.raises(FormatError):
                load(path)


@settings(max_examples=1000, deadline=None, suppress_health_check=list(HealthCheck), database=None)
@given(
    st.booleans(),
    st.lists(st.tuples(st.floats(0, 0.9999), st.integers(0, 255)), min_size=1, max_size=4),
)
def test_flipped_bytes_read_or_are_refused(tmp_path: Path, in_skeleton: bool, flips: list[tuple[float, int]]) -> None:
    text = bytearray(ASF if in_skeleton else TEXT)
    for at, byte in flips:
        text[int(at * len(text))] = byte
    path = save(tmp_path, TEXT, bytes(text)) if in_skeleton else save(tmp_path, bytes(text))
    try:
        take = load(path)
    except FormatError:
        return
    assert np.isfinite(take.positions[take.trusted]).all()
    amc.write(take, tmp_path / "out.amc")
    assert (tmp_path / "out.amc").read_bytes() == path.read_bytes()


def check_repair(take: Take, folder: Path, text: bytes, joint: str, rows_of: set[bytes]) -> Take:
    """Fill one joint in its second frame; only numbers of its row of that frame may change."""
    out = folder / "out.amc"
    filled = turned(take, joint, slice(1, 2), 8.0)
    written = amc.write(filled, out)
    amc.prove(written, out)
    assert written.filled.sum() == 1
    old, new = text.splitlines(keepends=True), out.read_bytes().splitlines(keepends=True)
    number, changed = b"", set()
    for before, after in zip(old, new, strict=True):
        number = before.strip() if before.strip().isdigit() else number
        assert re.split(rb"\S+", before) == re.split(rb"\S+", after)
        assert before.split()[:1] == after.split()[:1]
        assert before == after or before.split()[:1] == [joint.encode()]
        changed |= {number} if before != after else set()
    assert changed == rows_of
    again = amc.read(out, ReadOptions(skeleton=folder / "05.asf"))
    np.testing.assert_allclose(again.positions, written.positions, atol=1e-6)
    np.testing.assert_allclose(again.poses, filled.poses, atol=1e-4)
    return written


def test_filled_joint_changes_only_its_numbers(tmp_path: Path, small: Path) -> None:
    check_repair(load(small), tmp_path, TEXT, "tibia", {b"2"})


def test_repair_in_radians_is_spelled_finely(tmp_path: Path) -> None:
    text = re.sub(
        rb"(femur|tibia|chest)((?: \S+)+)",
        lambda m: m[1] + b"".join(b" %.3f" % np.radians(float(v)) for v in m[2].split()),
        TEXT.replace(b":DEGREES", b":radians"),
    )
    check_repair(load(save(tmp_path, text)), tmp_path, text, "tibia", {b"2"})
    tibia = (tmp_path / "out.amc").read_bytes().splitlines()[11].split()
    assert max(len(token.partition(b".")[2]) for token in tibia) >= 8


def test_missing_bone_is_filled(tmp_path: Path, small: Path) -> None:
    truth = load(small)
    take = load(save(tmp_path, TEXT.replace(b"tibia 21.5 -1.25", b"tibia nan nan").replace(b"1.7 2.7", b"nan 2.7")))
    tibia = take.markers.index("tibia")
    filled, poses = take.filled.copy(), take.poses.copy()
    filled[1, tibia] = True
    poses[:, take.owners == tibia] = truth.poses[:, take.owners == tibia]
    written = amc.write(replace(with_poses(take, poses), filled=filled), tmp_path / "out.amc")
    amc.prove(written, tmp_path / "out.amc")
    assert np.linalg.norm(written.positions[1, tibia] - truth.positions[1, tibia]) < 1e-3
    text = (tmp_path / "out.amc").read_bytes()
    assert text.count(b"nan") == 1
    assert b"chest nan 2.7" in text


def test_new_files_read_back(tmp_path: Path, small: Path, rng: np.random.Generator) -> None:
    skeleton = asf.read_skeleton(tmp_path / "05.asf")
    poses = rng.uniform(-170, 170, (5, len(skeleton.channels)))
    poses[3, 7] = np.nan
    write(posed_take(skeleton, poses, 120.0), tmp_path / "07_01.amc")
    assert (tmp_path / "07.asf").exists()
    take = load(tmp_path / "07_01.amc")
    assert take.markers == skeleton.names
    expected = forward(skeleton, poses)[0]
    known = np.isfinite(expected).all(axis=2)
    np.testing.assert_array_equal(take.as_markers().trusted, known)
    np.testing.assert_allclose(take.positions[known], expected[known], atol=1e-3)
