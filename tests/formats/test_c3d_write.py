"""C3D: what may change in a patched file, and what a new one holds."""

import dataclasses
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from c3d_builder import C3D, DEC, ENCODING_IDS, ENCODINGS, INTEL, floats, walk
from c3d_takes import differing, fill, load, store
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mocapclean.errors import FormatError, UsageError
from mocapclean.formats import c3d
from mocapclean.take import Exchanged, ReadOptions, Take

# Writing


@pytest.mark.parametrize(("machine", "is_float"), ENCODINGS, ids=ENCODING_IDS)
def test_one_filled_sample_changes_only_itself(tmp_path: Path, machine: int, is_float: bool) -> None:
    points = walk()
    points[17, 2] = 0
    file = C3D(points, machine, is_float, scale=0.25, analog=np.ones((40, 6)), tail=b"kept")
    take = fill(load(tmp_path, file), (17, 2), position=(100.3, -7.77, 0.01))
    out = tmp_path / "out.c3d"
    written = c3d.write(take, out)
    c3d.prove(written, out)
    old, new = file.build(), out.read_bytes()
    word = 4 if is_float else 2
    place = file.data_start() + (17 * 26 + 2 * 4) * word
    changed = differing(old, new)
    assert place <= changed.min() <= changed.max() < place + 4 * word
    again = c3d.read(out, ReadOptions())
    np.testing.assert_array_equal(again.positions, written.positions)
    assert again.trusted.all()
    resolution = 1e-5 if is_float else 0.125
    np.testing.assert_allclose(again.positions[17, 2], (100.3, -7.77, 0.01), atol=resolution)
    assert new[place + 3 * word : place + 4 * word] == bytes(word)


@pytest.mark.parametrize(("machine", "is_float"), ENCODINGS, ids=ENCODING_IDS)
def test_nothing_filled_is_a_copy(tmp_path: Path, machine: int, is_float: bool) -> None:
    points = walk()
    points[4:9, 1] = 0
    out = tmp_path / "out.c3d"
    take = load(tmp_path, C3D(points, machine, is_float))
    c3d.prove(c3d.write(take, out), out)
    assert out.read_bytes() == (tmp_path / "take.c3d").read_bytes()


@pytest.mark.parametrize(("machine", "is_float"), ENCODINGS, ids=ENCODING_IDS)
def test_an_exchanged_sample_takes_its_residual_word_along(tmp_path: Path, machine: int, is_float: bool) -> None:
    """Two exchanges that overlap, in runs of frames that are written apart: every word of a sample goes with it."""
    points = walk(9000, 4)
    points[..., 3] = np.arange(1, 5) * 257
    swapped = points.copy()
    for first, second, span in ((0, 2, slice(4000, 6000)), (2, 3, slice(5500, 8000))):
        swapped[span, [first, second]] = swapped[span, [second, first]]
    take = load(tmp_path, C3D(swapped, machine, is_float))
    positions, moved = take.positions.copy(), take.moved.copy()
    pairs = (Exchanged("M3", "M4", 5500, 8000), Exchanged("M1", "M3", 4000, 6000))
    for pair in pairs:
        span, both = slice(pair.start, pair.stop), [take.markers.index(pair.first), take.markers.index(pair.second)]
        positions[span, both] = positions[span, both[::-1]]
        moved[span, both] = True
    exchanged = dataclasses.replace(take, positions=positions, moved=moved, exchanged=pairs)
    out = tmp_path / "out.c3d"
    c3d.prove(c3d.write(exchanged, out), out)
    assert out.read_bytes() == C3D(points, machine, is_float).build()
    spoiled = bytearray(out.read_bytes())
    width = 4 if is_float else 2
    spoiled[C3D(points, machine, is_float).data_start() + (4500 * 16 + 3) * width] ^= 1
    out.write_bytes(spoiled)
    with pytest.raises(FormatError, match="must stay as it was"):
        c3d.prove(exchanged, out)


@pytest.mark.parametrize(("machine", "is_float"), ENCODINGS, ids=ENCODING_IDS)
def test_invalidate_marks_only_the_residual(tmp_path: Path, machine: int, is_float: bool) -> None:
    points = walk()
    points[4, 1] = 0
    take = load(tmp_path, C3D(points, machine, is_float))
    trusted = take.trusted.copy()
    trusted[[7, 8], [2, 3]] = False
    take = fill(dataclasses.replace(take, trusted=trusted), (8, 3))
    out = tmp_path / "out.c3d"
    written = c3d.write(take, out, invalidate=True)
    c3d.prove(written, out)
    again = c3d.read(out, ReadOptions())
    np.testing.assert_array_equal(again.positions, written.positions)
    np.testing.assert_array_equal(np.argwhere(~again.trusted), [[4, 1], [7, 2]])
    word = 4 if is_float else 2
    assert len(differing((tmp_path / "take.c3d").read_bytes(), out.read_bytes())) <= 5 * word


def test_fills_are_written_in_the_files_unit(tmp_path: Path) -> None:
    out = tmp_path / "out.c3d"
    c3d.write(fill(load(tmp_path, C3D(walk(), units="m")), (3, 0), position=(1500.0, 20.0, 3.0)), out)
    assert floats([1.5, 0.02, 0.003], INTEL) in out.read_bytes()


@pytest.mark.parametrize(
    ("file", "position"),
    [
        (C3D(walk(), is_float=False, first_frame=50), (3300.0, 0.0, 0.0)),
        (C3D(walk(), first_frame=50), (1e39, 0.0, 0.0)),
        (C3D(walk(), DEC, first_frame=50), (1e38, 0.0, 0.0)),
        (C3D(walk(), first_frame=50), (np.nan, 0.0, 0.0)),
    ],
    ids=["int", "float", "dec", "nan"],
)
def test_a_fill_that_does_not_fit_names_frame_and_marker(tmp_path: Path, file: C3D, position: object) -> None:
    take = fill(load(tmp_path, file), (7, 1), position=position)
    with pytest.raises(FormatError, match="frame 57, marker M2: a filled position must be finite and within"):
        c3d.write(take, tmp_path / "out.c3d")


@pytest.mark.parametrize("is_float", [True, False])
def test_a_fill_that_would_read_as_missing_is_left_out(tmp_path: Path, is_float: bool) -> None:
    points = walk()
    points[7, 1] = 0
    take = fill(load(tmp_path, C3D(points, is_float=is_float)), (7, 1), (8, 1), position=(0.0, 0.0, 0.0))
    take = fill(take, (9, 1))
    out = tmp_path / "out.c3d"
    written = c3d.write(take, out)
    c3d.prove(written, out)
    assert np.argwhere(written.filled).tolist() == [[9, 1]]
    assert "2 fills" in written.findings[-1].message
    np.testing.assert_array_equal(written.positions, c3d.read(out, ReadOptions()).positions)


@given(place=st.integers(0, 10_000), mask=st.integers(1, 255))
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_prove_sees_every_stray_byte(tmp_path: Path, place: int, mask: int) -> None:
    points = walk()
    points[4:9, 1] = 0
    take = fill(load(tmp_path, C3D(points, analog=np.ones((40, 3)), tail=b"kept")), (4, 1), (5, 1))
    out = tmp_path / "out.c3d"
    written = c3d.write(take, out)
    content = bytearray(out.read_bytes())
    content[place % len(content)] ^= mask
    out.write_bytes(content)
    with pytest.raises(FormatError):
        c3d.prove(written, out)


def test_a_changed_source_is_not_patched(tmp_path: Path) -> None:
    take = fill(load(tmp_path, C3D(walk())), (0, 0))
    store(tmp_path, C3D(walk(), labels=list("VWXYZ")))
    with pytest.raises(FormatError, match="read it again"):
        c3d.write(take, tmp_path / "out.c3d")


def test_a_cropped_take_cannot_be_patched(tmp_path: Path) -> None:
    take = load(tmp_path, C3D(walk()))
    part = dataclasses.replace(take.crop(0, 9), origin=take.origin)
    with pytest.raises(UsageError, match=r"\(40, 5\).*Got \(9, 5\)"):
        c3d.write(part, tmp_path / "out.c3d")


@pytest.mark.parametrize(("machine", "is_float"), ENCODINGS, ids=ENCODING_IDS)
def test_reading_takes_at_most_four_times_the_point_block(tmp_path: Path, machine: int, is_float: bool) -> None:
    path = store(tmp_path, C3D(walk(20_000, 40), machine, is_float))
    tracemalloc.start()
    c3d.read(path, ReadOptions())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak <= 4 * 20_000 * 40 * 4 * (4 if is_float else 2) + 8e6


# New files


def test_a_new_file_reads_back(tmp_path: Path, rng: np.random.Generator) -> None:
    trusted = rng.random((50, 300)) > 0.2
    positions = np.where(trusted[..., None], rng.normal(0, 1000, (50, 300, 3)), np.nan)
    filled = ~trusted & (rng.random((50, 300)) > 0.5)
    positions[filled] = 5.0
    names = ("Größe", "*12", *(f"Bob:M{i}" for i in range(298)))
    take = Take(positions=positions, trusted=trusted, filled=filled, markers=names, rate=119.88, first_frame=77)
    c3d.create(take, tmp_path / "new.c3d")
    stored = c3d.read(tmp_path / "new.c3d", ReadOptions(points=("*12",)))
    known = trusted | filled
    assert stored.markers == names
    assert stored.rate == pytest.approx(119.88, rel=1e-7)
    assert stored.first_frame == 77
    np.testing.assert_array_equal(stored.trusted, known)
    np.testing.assert_array_equal(stored.positions[known], positions[known].astype(np.float32))
    assert np.isfinite(stored.positions).all()
    assert stored.findings == ()
    document = stored.origin.document  # type: ignore[union-attr]
    with document.path.open("rb") as file:
        residuals = document.samples(document.load(file, 0, 50))[..., 3]
    np.testing.assert_array_equal(residuals, np.where(known, 0.0, -1.0))


def new_take(n_frames: int = 3, **changes: object) -> Take:
    positions = np.ones((n_frames, 1, 3))
    fields = {"positions": positions, "trusted": np.ones((n_frames, 1), bool), "markers": ("A",), "rate": 100.0}
    return Take(**{**fields, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("take", "match"),
    [
        (new_take(65536), "1 to 65535 frames"),
        (new_take(0), "1 to 65535 frames"),
        (new_take(markers=("A" * 256,)), "1 to 255 bytes"),
        (new_take(markers=("A ",)), "1 to 255 bytes"),
        (new_take(markers=("",)), "1 to 255 bytes"),
        (new_take(positions=np.full((3, 1, 3), 1e39)), "frame 1, marker A: a position must be finite and within"),
        (new_take(rate=1e39), "frame rate"),
    ],
    ids=["long", "empty", "long name", "padded name", "no name", "far", "rate"],
)
def test_a_new_file_that_cannot_be_is_refused(tmp_path: Path, take: Take, match: str) -> None:
    with pytest.raises(FormatError, match=match):
        c3d.create(take, tmp_path / "new.c3d")


@pytest.mark.parametrize(("first_frame", "stored"), [(0, 1), (1, 1), (65535, 65535), (100_000, 100_000)])
def test_a_new_file_starts_where_the_take_does(tmp_path: Path, first_frame: int, stored: int) -> None:
    c3d.create(new_take(first_frame=first_frame), tmp_path / "new.c3d")
    assert c3d.read(tmp_path / "new.c3d", ReadOptions()).first_frame == stored
