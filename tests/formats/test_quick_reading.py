"""Quick reading gives what reading word by word gives, number for number and fault for fault, and is really taken."""

import random
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import test_amc
import test_bvh
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from mocapclean.errors import FormatError
from mocapclean.formats import amc, bvh
from mocapclean.formats.alike import frames_alike
from mocapclean.formats.poses import PoseDocument
from mocapclean.formats.text import LARGEST_NUMBER, blank, is_plain, numbers, quick_table
from mocapclean.take import ReadOptions

NUMBERS = st.one_of(
    st.floats(-LARGEST_NUMBER, LARGEST_NUMBER).map(lambda value: repr(value).encode()),
    st.floats(-360, 360).map(lambda value: b"%.4f" % value),
    st.from_regex(rb"[+-]?(\d{1,25}\.?\d{0,25}|\.\d{1,25})([eE][+-]?\d{1,3})?", fullmatch=True),
    st.sampled_from([b"nan", b"-NaN", b"+nan", b"inf", b"1e9", b"1.0000001e9", b"1e400", b"4.9e-324", b"-0", b"007"]),
)
ODD = st.sampled_from(
    [b"1_0", b"0x10", b"1,5", b"--1", b"1.2.3", b"nan(1)", b"1e", b".", b"\xb2", b"1\xa02", b"1\x002"]
)
SPACES = st.text(" \t\x0b\x0c", min_size=1, max_size=3).map(str.encode)
# Bytes that matter to a reader of these texts come up more often than others.
BYTES = st.one_of(st.sampled_from([*b" \t\r\n\x0b\x0c\x1c\x85\xa0.,_#()-+eE0123456789naN"]), st.integers(0, 255))


def same(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether two tables have the same bits; all NaN count as the same."""
    return first.shape == second.shape and (
        np.where(np.isnan(first), 1.0, first).tobytes() == np.where(np.isnan(second), 1.0, second).tobytes()
        and np.array_equal(np.isnan(first), np.isnan(second))
    )


def outcome(read: Callable[[], PoseDocument]) -> PoseDocument | str:
    try:
        return read()
    except FormatError as fault:
        return str(fault)


def check_same(monkeypatch: pytest.MonkeyPatch, module: object, quick: str, read: Callable[[], PoseDocument]) -> None:
    """Check that a reading has the same outcome with and without its quick part."""
    first = outcome(read)
    with monkeypatch.context() as patch:
        patch.setattr(module, quick, lambda *_: None)
        second = outcome(read)
    if isinstance(first, str) or isinstance(second, str):
        assert first == second
        return
    assert same(first.poses, second.poses)
    for name in ("starts", "places", "scale"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


@settings(max_examples=500, deadline=None, database=None)
@given(
    st.integers(1, 5).flatmap(lambda n: st.lists(st.lists(NUMBERS | ODD, min_size=n, max_size=n), min_size=1)), SPACES
)
def test_quick_tables_have_the_same_numbers(words: list[list[bytes]], space: bytes) -> None:
    rows = [space.join(row) for row in words]
    quick = quick_table(rows) if is_plain(b"\n".join(rows)) else None
    path = Path("take.bvh")
    try:
        slow = numbers(path, [row.split() for row in rows], range(len(rows)))
    except FormatError:
        assert quick is None
        return
    if quick is not None:
        assert same(quick.reshape(-1), slow)
    else:  # words with other bytes are left to the slow reading
        assert not is_plain(b"\n".join(rows)) or len({len(row.split()) for row in rows}) > 1


@settings(max_examples=2000, deadline=None, suppress_health_check=list(HealthCheck), database=None)
@given(
    st.lists(st.tuples(st.floats(0, 0.9999), BYTES, st.booleans()), max_size=3),
    st.sampled_from([b"\n", b"\r\n", b"\r"]),
)
@example([], b"\n")
def test_bvh_reads_alike_both_ways(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, edits: list[tuple[float, int, bool]], end: bytes
) -> None:
    text = edited(test_bvh.TEXT, test_bvh.TEXT.index(b"MOTION"), edits).replace(b"\n", end)
    path = test_bvh.save(tmp_path, text)
    check_same(monkeypatch, bvh, "quick_table", lambda: bvh.read(path, ReadOptions()).origin.document)


@settings(max_examples=2000, deadline=None, suppress_health_check=list(HealthCheck), database=None)
@given(
    st.lists(st.tuples(st.floats(0, 0.9999), BYTES, st.booleans()), max_size=3),
    st.sampled_from([b"\n", b"\r\n", b"\r"]),
)
@example([], b"\n")
def test_amc_reads_alike_both_ways(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, edits: list[tuple[float, int, bool]], end: bytes
) -> None:
    text = edited(test_amc.TEXT, 0, edits).replace(b"\n", end)
    path = test_amc.save(tmp_path, text)
    check_same(monkeypatch, amc, "frames_alike", lambda: amc.read(path, ReadOptions()).origin.document)


def edited(text: bytes, first: int, edits: list[tuple[float, int, bool]]) -> bytes:
    """Return a text with bytes replaced or inserted behind its first ones."""
    changed = bytearray(text)
    for share, byte, insert in edits:
        at = first + int(share * (len(changed) - first))
        changed[at : at + (not insert)] = bytes([byte])
    return bytes(changed)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"\n", b"\r\n"),
        (b" ", b" \t"),
        (b"chest 1.6 2.6 3.6\n", b"chest 1.6 nan -7.6e-016\n"),
        (b"chest 1.8 2.8 3.8\n", b"chest 1.8 2.8 3.8"),
        (b"chest 1.8 2.8 3.8\n", b"chest 1.8 2.8 3.8 \n\n \n"),
        (b":DEGREES\n", b"# a comment, with 3\n:DEGREES\n"),
    ],
)
def test_regular_amc_is_read_quickly(old: bytes, new: bytes) -> None:
    assert old in test_amc.TEXT
    alike = frames_alike(blank(test_amc.TEXT.replace(old, new)))
    assert alike is not None
    assert (alike.names, alike.first_frame, len(alike.rows)) == ([b"root", b"femur", b"tibia", b"chest"], 1, 4)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"\n3\n", b"\n5\n"),
        (b"\n3\n", b"\n3.\n"),
        (b"\n1\n", b"\n 1\n"),
        (b"femur -1.15 2.35 31.125\ntibia 21.5 -1.25\n", b"femur -1.15 2.35\n31.125 tibia 21.5 -1.25\n"),
        (b"femur -1.15 2.35 31.125\ntibia 21.5 -1.25\n", b"tibia 21.5 -1.25\nfemur -1.15 2.35 31.125\n"),
        (b"tibia 21.5 -1.25\nchest", b"tibia 21.5 -1.25 chest"),
        (b"tibia 21.5 -1.25\n", b"tibia 21.5 -1.25\n\n"),
        (b"tibia 21.5", b"tibja 21.5"),
        (b"tibia 21.5", b"tibia21.5 1"),
        (b"chest 1.6 2.6 3.6\n", b"chest 1.6 2.6 3.6\r"),
        (b"chest 1.6 2.6 3.6\n", b"chest 1.6\r2.6 3.6\n"),
    ],
)
def test_irregular_amc_is_not_taken_for_regular(old: bytes, new: bytes) -> None:
    assert old in test_amc.TEXT
    assert frames_alike(blank(test_amc.TEXT.replace(old, new))) is None


def test_long_texts_are_read_alike_across_chunks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Chunks of a few words: no word, line or name may be lost at their ends."""
    draw = random.Random(3)
    blocks = [re.sub(rb"(?<= )\S+", lambda _: b"%.*f" % (draw.randint(0, 9), draw.uniform(-360, 360)), body)
              for body in re.split(rb"(?m)^\d\n", test_amc.TEXT)[1:] * 25]  # fmt: skip
    header = test_amc.TEXT[: test_amc.TEXT.index(b"\n1\n") + 1]
    text = header + b"".join(b"%d\n%b" % (number, body) for number, body in enumerate(blocks, start=98))
    for end in (b"\n", b"\r\n"):
        path = test_amc.save(tmp_path, text.replace(b"\n", end))
        for chunk in (1, 2, 3, 7, 64, 1 << 20):
            monkeypatch.setattr("mocapclean.formats.alike.CHUNK_BYTES", chunk)
            monkeypatch.setattr("mocapclean.formats.alike.CHUNK_FRAMES", min(chunk, 9))
            assert frames_alike(path.read_bytes()) is not None
            check_same(monkeypatch, amc, "frames_alike", lambda: amc.read(path, ReadOptions()).origin.document)  # noqa: B023


@pytest.mark.parametrize("name", ["bvh", "amc", "c3d"])
def test_reading_imports_nothing_that_only_new_files_need(name: str) -> None:
    code = f"import sys, mocapclean.formats.{name}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    heavy = {"bvhio", "glm", "ezc3d", "scipy.spatial", "mocapclean.geometry.inverse_kinematics"}
    assert not heavy & set(loaded)
