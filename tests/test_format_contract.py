"""The laws of every format, over the samples, a format made for the test, and every real capture."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import capture_files
from posed_takes import turned
from table_texts import TEXTS
from toy_format import ToyFormat

import mocapclean
from mocapclean import formats
from mocapclean.config.settings import Settings
from mocapclean.errors import FormatError, UsageError
from mocapclean.formats import FORMATS
from mocapclean.formats.declarations import DECLARATIONS
from mocapclean.pipeline.repair import repair

SAMPLES = Path(__file__).resolve().parents[1] / "sample_data"
EVERY_SAMPLE = sorted(p for p in SAMPLES.iterdir() if p.suffix[1:] in FORMATS)
EVERY_CAPTURE = [path for kind in FORMATS for path in capture_files(kind)]


TOY = Path("toy")
TABLES = [Path(f"walk.{name}") for name in ("trc", "qualisys", "csv", "motive", "nexus")]
TEXT_NAMES = [Path(name) for name in TEXTS]
MAIN = [*EVERY_SAMPLE, TOY, *TABLES, *TEXT_NAMES]


@pytest.fixture
def path(request, tmp_path_factory, monkeypatch):
    """A file to hold the laws against; those of the toy format and of tables are created by the public function."""
    if request.param in TEXT_NAMES:
        made = tmp_path_factory.mktemp("text") / request.param
        made.write_bytes(TEXTS[request.param.name])
        return made
    if request.param in TABLES:
        return new_table(request.param.suffix[1:], tmp_path_factory.mktemp("table"))
    if request.param is not TOY:
        return request.param
    monkeypatch.setitem(DECLARATIONS, "toy", ToyFormat.DECLARATION)
    monkeypatch.setitem(FORMATS, "toy", ToyFormat())
    created = tmp_path_factory.mktemp("toy") / "walk.toy"
    mocapclean.write(mocapclean.read(SAMPLES / "walk.c3d").crop(0, 120), created)
    return created


def new_table(name, folder):
    """A table of a part of the walk in a format, with gaps."""
    created = folder / f"walk{DECLARATIONS[name].suffixes[0]}"
    mocapclean.write(mocapclean.read(SAMPLES / "walk.c3d").crop(0, 120), created, format=name)
    return created


def read_or_skip(path):
    try:
        return mocapclean.read(path)
    except FormatError as refused:
        pytest.skip(f"refused: {refused}")


@pytest.mark.parametrize("path", MAIN + EVERY_CAPTURE, ids=lambda p: p.name, indirect=True)
def test_a_take_keeps_the_promises_of_its_record(path):
    take = read_or_skip(path)
    assert np.isfinite(take.positions[take.trusted]).all()
    assert np.isfinite(take.rate)
    assert take.rate > 0
    assert not take.filled.any()
    assert not take.positions.flags.writeable
    assert take.origin.path == path


@pytest.mark.parametrize("path", MAIN + EVERY_CAPTURE, ids=lambda p: p.name, indirect=True)
def test_read_then_write_gives_identical_bytes(path, tmp_path):
    take = read_or_skip(path)
    written = mocapclean.write(take, tmp_path / path.name)
    assert (tmp_path / path.name).read_bytes() == path.read_bytes()
    np.testing.assert_array_equal(written.positions, take.positions)


@pytest.mark.parametrize("path", MAIN, ids=lambda p: p.name, indirect=True)
def test_filled_samples_come_back_as_reported_and_nothing_else_moves(path, tmp_path, rng):
    take = mocapclean.read(path)
    frame, marker = len(take.trusted) // 2, len(take.markers) - 3
    span = slice(frame, frame + 5)
    if take.poses is not None:
        repaired = turned(take, take.markers[take.owners[-1]], span, 3.0)
    else:
        positions, trusted, filled = take.positions.copy(), take.trusted.copy(), take.filled.copy()
        positions[span, marker] = take.positions[frame - 20, marker] + rng.normal(size=(5, 3))
        trusted[span, marker], filled[span, marker] = False, True
        repaired = replace(take, positions=positions, trusted=trusted, filled=filled)
    out, filled = tmp_path / path.name, repaired.filled
    written = mocapclean.write(repaired, out)
    back = mocapclean.read(out, skeleton=take.origin.options.skeleton or next(iter(SAMPLES.glob("walk.asf")), None))
    where = written.filled
    assert not (where & ~filled).any()
    np.testing.assert_allclose(back.positions[where], written.positions[where], atol=1e-3)
    others = take.trusted & ~filled
    if take.poses is None:
        np.testing.assert_allclose(back.positions[others], take.positions[others], atol=0.1)
    else:
        same = ~filled[:, take.owners]
        np.testing.assert_array_equal(back.poses[same], take.poses[same])
    untouched = others & ~filled.any(axis=1, keepdims=True)
    np.testing.assert_array_equal(back.positions[untouched], take.positions[untouched])


@pytest.mark.parametrize("path", MAIN, ids=lambda p: p.name, indirect=True)
def test_distrusted_samples_are_marked_missing_where_the_format_has_a_mark(path, tmp_path):
    take = mocapclean.read(path)
    trusted = take.trusted.copy()
    trusted[3:6, 2] = False
    out = tmp_path / path.name
    mocapclean.write(replace(take, trusted=trusted), out, invalidate=True)
    back = mocapclean.read(out, skeleton=SAMPLES / "walk.asf")
    if formats.declaration(path).marks_missing:
        np.testing.assert_array_equal(back.trusted, trusted)
    else:
        assert out.read_bytes() == path.read_bytes()


@pytest.mark.parametrize("path", MAIN, ids=lambda p: p.name, indirect=True)
def test_a_file_that_differs_elsewhere_is_not_proven(path, tmp_path):
    take = mocapclean.read(path)
    module = FORMATS[formats.format_of(path)]
    out = tmp_path / path.name
    written = module.write(take, out)
    module.prove(written, out)
    content = bytearray(out.read_bytes())
    content[-3] ^= 1
    out.write_bytes(content)
    with pytest.raises(FormatError):
        module.prove(written, out)


@pytest.mark.parametrize("path", MAIN, ids=lambda p: p.name, indirect=True)
def test_a_declaration_is_true(path):
    facts = formats.declaration(path)
    take = mocapclean.read(path)
    assert path.suffix in facts.suffixes
    assert formats.suffixes().count(path.suffix) == 1
    assert formats.format_of(path) == take.origin.format
    assert (facts.columns == "joints") == (take.skeleton is not None and take.markers == take.skeleton.names)
    assert (facts.stores == "poses") == (take.poses is not None)
    assert formats.needs_skeleton(path) == (formats.companion(path) is not None)
    assert facts.default_rate in (None, take.rate)
    rules = {finding.rule for finding in take.findings}
    assert ("units" in rules) == (facts.default_unit is not None)
    assert ("rate" in rules) == (facts.default_rate is not None)


def test_a_toy_take_is_repaired_by_the_command(tmp_path, monkeypatch):
    monkeypatch.setitem(DECLARATIONS, "toy", ToyFormat.DECLARATION)
    monkeypatch.setitem(FORMATS, "toy", ToyFormat())
    mocapclean.write(mocapclean.read(SAMPLES / "walk.c3d").crop(0, 120), tmp_path / "walk.toy")
    outcome = repair(tmp_path / "walk.toy", tmp_path / "out.toy", Settings(method="linear", self_check=False))
    assert (outcome.status, outcome.format) == ("repaired", "toy")
    before, after = mocapclean.read(tmp_path / "walk.toy"), mocapclean.read(tmp_path / "out.toy")
    np.testing.assert_array_equal(after.positions[before.trusted], before.positions[before.trusted])
    assert after.trusted.sum() > before.trusted.sum()


def test_a_moved_sample_of_a_c3d_stays_a_measured_one(tmp_path):
    path = SAMPLES / "walk_truth.c3d"
    take = mocapclean.read(path)
    positions, moved = take.positions.copy(), np.zeros_like(take.trusted)
    moved[7, 5] = True
    positions[7, 5] += 1.0
    mocapclean.write(replace(take, positions=positions, moved=moved), tmp_path / "out.c3d")
    old, new = (np.frombuffer(p.read_bytes(), np.uint8) for p in (path, tmp_path / "out.c3d"))
    different = np.flatnonzero(old != new)
    assert 0 < len(different) <= 12
    assert different.max() - different.min() < 12
    back = mocapclean.read(tmp_path / "out.c3d")
    np.testing.assert_allclose(back.positions[7, 5], positions[7, 5], atol=1e-4)


@pytest.mark.parametrize("path", MAIN, ids=lambda p: p.name, indirect=True)
def test_the_input_is_never_the_output(path, tmp_path):
    copy = tmp_path / path.name
    shutil.copy(path, copy)
    shutil.copy(SAMPLES / "walk.asf", tmp_path / "walk.asf")
    take = mocapclean.read(copy)
    (tmp_path / f"link{path.suffix}").symlink_to(copy)
    for output in (copy, tmp_path / f"link{path.suffix}"):
        with pytest.raises(UsageError, match="must not be the input"):
            mocapclean.write(take, output, overwrite=True)
    assert copy.read_bytes() == path.read_bytes()


@pytest.mark.parametrize("path", MAIN, ids=lambda p: p.name, indirect=True)
def test_an_input_that_changed_since_reading_is_not_patched(path, tmp_path):
    copy = tmp_path / path.name
    shutil.copy(path, copy)
    shutil.copy(SAMPLES / "walk.asf", tmp_path / "walk.asf")
    take = mocapclean.read(copy)
    copy.write_bytes(path.read_bytes()[:-40])
    out = tmp_path / f"out{path.suffix}"
    try:
        mocapclean.write(take, out)
    except FormatError:
        assert not out.exists()
    else:
        assert out.read_bytes() == path.read_bytes()
    assert not list(tmp_path.glob(".*"))


def test_joints_can_be_exported_as_c3d_and_poses_not_to_a_skeleton_of_another_kind(tmp_path):
    take = mocapclean.read(SAMPLES / "walk.bvh")
    mocapclean.write(take, tmp_path / "joints.c3d")
    # A joint in the place of another one is read as a copy of it, unless it is asked for.
    copies = ("LeftShoulder", "RightShoulder")
    assert set(take.markers) - set(mocapclean.read(tmp_path / "joints.c3d").markers) == set(copies)
    back = mocapclean.read(tmp_path / "joints.c3d", points=copies)
    np.testing.assert_array_equal(back.trusted, take.trusted)
    np.testing.assert_allclose(back.positions[take.trusted], take.positions[take.trusted], atol=1e-3)
    with pytest.raises(UsageError, match=r"joints\.amc: the bones of an \.asf skeleton must"):
        mocapclean.write(take, tmp_path / "joints.amc")
    with pytest.raises(UsageError, match=r"joints\.bvh: a BVH skeleton must"):
        mocapclean.write(mocapclean.read(SAMPLES / "walk_01.amc"), tmp_path / "joints.bvh")
    assert {file.name for file in tmp_path.iterdir()} == {"joints.c3d"}


@pytest.mark.parametrize("suffix", [".bvh", ".amc"])
def test_positions_alone_are_not_a_pose(tmp_path, suffix):
    take = mocapclean.read(SAMPLES / "walk.c3d")
    with pytest.raises(UsageError, match="positions alone are not a pose"):
        mocapclean.write(take, tmp_path / f"take{suffix}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["walk.bvh", "walk_01.amc"])
def test_a_part_of_a_take_with_poses_becomes_a_new_file(tmp_path, name):
    take = mocapclean.read(SAMPLES / name)
    part = take.crop(100, 200)
    mocapclean.write(part, tmp_path / name)
    skeleton = formats.declaration(tmp_path / name).skeleton_suffix
    assert {file.suffix for file in tmp_path.iterdir()} == {Path(name).suffix, skeleton} - {None}
    back = mocapclean.read(tmp_path / name)
    assert sorted(back.markers) == sorted(part.markers)
    columns = [back.markers.index(marker) for marker in part.markers]
    np.testing.assert_array_equal(back.trusted[:, columns], part.trusted)
    np.testing.assert_allclose(back.positions[:, columns][part.trusted], part.positions[part.trusted], atol=0.01)
    assert back.rate == pytest.approx(part.rate)


def test_takes_of_a_subject_share_their_skeleton_file(tmp_path):
    take = mocapclean.read(SAMPLES / "walk_01.amc")
    for name in ("05_01.amc", "05_02_again.amc"):
        mocapclean.write(take.crop(0, 9), tmp_path / name)
    assert {file.name for file in tmp_path.iterdir()} == {"05.asf", "05_01.amc", "05_02_again.amc"}
    (tmp_path / "05.asf").write_bytes(b"another")
    with pytest.raises(UsageError, match=r"05\.asf: the output exists already"):
        mocapclean.write(take.crop(0, 9), tmp_path / "05_03.amc")
    assert {file.name for file in tmp_path.iterdir()} == {"05.asf", "05_01.amc", "05_02_again.amc"}
    mocapclean.write(take.crop(0, 9), tmp_path / "05_03.amc", overwrite=True)
    assert mocapclean.read(tmp_path / "05_03.amc").trusted.shape == (9, len(take.markers))


@pytest.mark.parametrize("name", ["take.txt", "take", "take.c3d.gz"])
def test_other_suffixes_are_refused(tmp_path, name):
    (tmp_path / name).write_bytes(b"1")
    with pytest.raises(FormatError, match="must end in one of"):
        mocapclean.read(tmp_path / name)
