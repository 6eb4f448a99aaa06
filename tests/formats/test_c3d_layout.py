"""C3D: header and parameters that do not agree on where the points are, and how many there are."""

import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from c3d_builder import C3D, ENCODING_IDS, ENCODINGS, INTEL, MIPS, Parameter, floats, shorts, walk
from c3d_takes import differing, fill, load, rules, trial
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mocapclean.errors import FormatError
from mocapclean.formats import c3d
from mocapclean.take import ReadOptions, Take

# Bytes of 16-bit words of the header.
PLACES = {"points": 2, "analog": 4, "first": 6, "last": 8, "block": 16, "subframes": 18}
SCALE = 12


def spoiled(file: C3D, scale: float | None = None, **words: int) -> bytes:
    """The file with other words, or another scale, in its header."""
    content = bytearray(file.build())
    for name, value in words.items():
        at = PLACES[name]
        content[at : at + 2] = struct.pack(">H" if file.machine == MIPS else "<H", value)
    if scale is not None:
        content[SCALE : SCALE + 4] = floats([scale], file.machine)
    return bytes(content)


def used(group: str, count: int, machine: int = INTEL) -> dict[str, Parameter]:
    return {f"{group}:USED" if group != "POINT" else "USED": (group, "USED", 2, (), shorts([count], machine))}


def analog_rate(rate: float, machine: int) -> dict[str, Parameter]:
    return {"ANALOG:RATE": ("ANALOG", "RATE", 4, (), floats([rate], machine))}


def point_scale(scale: float, machine: int) -> dict[str, Parameter]:
    return {"SCALE": ("POINT", "SCALE", 4, (), floats([scale], machine))}


def data_start(file: C3D, shift: int = 0) -> dict[str, Parameter]:
    """POINT:DATA_START of a file, or so many blocks beside it."""
    entry = ("POINT", "DATA_START", 2, (), shorts([0], file.machine))
    file.extra["START"] = entry
    block = file.data_start() // 512 + 1 + shift
    return {"START": ("POINT", "DATA_START", 2, (), shorts([block], file.machine))}


def smooth(n_frames: int, n_points: int, seed: int = 3) -> np.ndarray:
    """Stored numbers (F, P, 4), whole, of points that are apart and move by some units a frame."""
    rng = np.random.default_rng(seed)
    points = np.full((n_frames, n_points, 4), 5.0)
    steps = rng.integers(-6, 7, (n_frames, n_points, 3))
    points[..., :3] = rng.integers(-4000, 4000, (1, n_points, 3)) + np.cumsum(steps, axis=0)
    return points


def is_read_and_repaired(folder: Path, content: bytes, file: C3D, *named: str) -> Take:
    """The take of a spoiled file is that of the sound one, one finding names the places, and a fill is in its place."""
    take = load(folder, content)
    factor = 1.0 if file.is_float else file.scale
    np.testing.assert_allclose(take.positions, file.points[..., :3] * factor, rtol=1e-6)
    (finding,) = [finding for finding in take.findings if finding.rule == "layout"]
    assert all(name in finding.message for name in named), finding.message
    c3d.prove(c3d.write(fill(take, (7, 2), position=(11 * factor,) * 3), folder / "out.c3d"), folder / "out.c3d")
    width = 4 if file.is_float else 2
    n_words = file.points[0].size + (0 if file.analog is None else file.analog.shape[1])
    first = file.data_start() + (7 * n_words + 2 * 4) * width
    changed = differing(content, (folder / "out.c3d").read_bytes())
    assert first <= changed.min()
    assert changed.max() < first + 4 * width
    return take


EACH_ENCODING = pytest.mark.parametrize(("machine", "is_float"), ENCODINGS, ids=ENCODING_IDS)


@EACH_ENCODING
@pytest.mark.parametrize("count", [0, 1, 15, 17, 60_000])
@pytest.mark.parametrize("is_header", [True, False], ids=["header", "parameter"])
def test_the_number_of_points_that_fills_the_file(tmp_path, machine, is_float, count, is_header) -> None:
    extra = {} if is_header else used("POINT", count, machine)
    file = C3D(smooth(90, 16), machine, is_float, analog=np.ones((90, 3)), extra=extra)
    content = spoiled(file, points=count) if is_header else file.build()
    is_read_and_repaired(tmp_path, content, file, "POINT:USED", str(count))


def test_255_of_277_points(tmp_path: Path) -> None:
    file = C3D(smooth(50, 277))
    assert len(is_read_and_repaired(tmp_path, spoiled(file, points=255), file, "255", "277").markers) == 277


def test_labels_give_the_number_that_no_other_place_has(tmp_path: Path) -> None:
    file = C3D(smooth(90, 16), extra=used("POINT", 13))
    is_read_and_repaired(tmp_path, spoiled(file, points=13), file, "13")


@EACH_ENCODING
@pytest.mark.parametrize("words", [0, 1, 9, 3000])
@pytest.mark.parametrize("rate", [100.0, 400.0])
def test_the_analog_words_that_fill_the_file(tmp_path, machine, is_float, words, rate) -> None:
    channels = 12 if rate == 100.0 else 3
    extra = {**used("ANALOG", channels, machine), **analog_rate(rate, machine)}
    analog = np.random.default_rng(1).integers(-3000, 3000, (80, 12))
    file = C3D(smooth(80, 6), machine, is_float, analog=analog, extra=extra)
    is_read_and_repaired(tmp_path, spoiled(file, analog=words), file, "ANALOG:USED", str(words), "12")


def test_the_header_has_the_analog_words_where_the_parameters_are_wrong(tmp_path: Path) -> None:
    file = C3D(smooth(80, 6), analog=np.ones((80, 7)), extra={**used("ANALOG", 5), **analog_rate(100.0, INTEL)})
    is_read_and_repaired(tmp_path, file.build(), file, "ANALOG:USED", "5", "7")


def test_samples_of_a_frame_stand_in_for_the_analog_rate(tmp_path: Path) -> None:
    file = C3D(smooth(80, 6), analog=np.ones((80, 8)), extra=used("ANALOG", 2))
    is_read_and_repaired(tmp_path, spoiled(file, analog=3, subframes=4), file, "analog words", "8")


@EACH_ENCODING
@pytest.mark.parametrize("is_header", [True, False], ids=["header", "parameter"])
def test_the_sign_of_the_scale_that_fills_the_file(tmp_path, machine, is_float, is_header) -> None:
    wrong = 0.25 if is_float else -0.25
    file = C3D(smooth(60, 9), machine, is_float, scale=0.25)
    if is_header:
        content = spoiled(file, scale=wrong)
    else:
        file.extra = point_scale(wrong, machine)  # type: ignore[assignment]
        content = file.build()
    is_read_and_repaired(tmp_path, content, file, "scale", "minus", "plus")


@EACH_ENCODING
@pytest.mark.parametrize("block", [0, 1, 2, 5, 9, 40_000])
def test_the_block_of_the_data_that_the_parameters_have(tmp_path, machine, is_float, block) -> None:
    file = C3D(smooth(60, 9), machine, is_float)
    file.extra = data_start(file)  # type: ignore[assignment]
    is_read_and_repaired(tmp_path, spoiled(file, block=block), file, "block")


@pytest.mark.parametrize("shift", [-2, 1, 4, 5000])
def test_the_block_of_the_data_that_the_header_has(tmp_path: Path, shift: int) -> None:
    file = C3D(smooth(60, 9))
    file.extra = data_start(file, shift)  # type: ignore[assignment]
    take = load(tmp_path, file)
    np.testing.assert_array_equal(take.positions, file.points[..., :3])


def test_the_data_follow_the_parameters_where_no_place_has_their_block(tmp_path: Path) -> None:
    file = C3D(smooth(60, 9))
    is_read_and_repaired(tmp_path, spoiled(file, block=0), file, "block")


def test_several_places_can_be_wrong(tmp_path: Path) -> None:
    extra = {**used("ANALOG", 4), **analog_rate(100.0, INTEL), **frames_of_16_bits(150)}
    file = C3D(smooth(150, 12), scale=0.5, analog=np.ones((150, 4)), extra=extra)
    content = spoiled(file, points=11, analog=0, scale=0.5, last=65535)
    is_read_and_repaired(tmp_path, content, file, "POINT:USED", "ANALOG:USED", "scale")


def test_point_data_over_the_parameters_are_refused_for_a_repair_would_change_what_is_read(tmp_path) -> None:
    file = C3D(walk())
    with pytest.raises(FormatError, match="must not lie over the parameter section") as refused:
        load(tmp_path, spoiled(file, block=2)[: file.data_start()])
    assert refused.value.byte == 512


@given(
    n_frames=st.integers(2, 30),
    n_points=st.integers(3, 12),
    n_analog=st.integers(0, 4),
    wrong=st.sampled_from(["points", "analog"]),
    by=st.sampled_from([-1, 1]),
    is_header=st.booleans(),
    seed=st.integers(0, 99),
)
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_short_takes_are_not_read_shifted(tmp_path, n_frames, n_points, n_analog, wrong, by, is_header, seed) -> None:
    """Frames so few that a wrong stride also ends in the last block: what is smooth is right."""
    counts = {"points": n_points, "analog": n_analog}
    counts[wrong] = max(counts[wrong] + by, 0)
    stated = {"points": n_points, "analog": n_analog} if is_header else counts
    extra = {**used("POINT", stated["points"]), **used("ANALOG", stated["analog"]), **analog_rate(100.0, INTEL)}
    rng = np.random.default_rng(seed)
    analog = rng.integers(-2000, 2000, (1, n_analog)) + rng.integers(-5, 6, (n_frames, n_analog))
    file = C3D(smooth(n_frames, n_points, seed), analog=analog, extra=extra)
    content = spoiled(file, **counts) if is_header else file.build()
    np.testing.assert_array_equal(load(tmp_path, content).positions, file.points[..., :3])


@pytest.mark.parametrize(
    ("words", "extra", "named"),
    [
        ({"points": 8}, {}, "POINT:USED"),
        ({}, used("POINT", 7), "POINT:USED"),
        ({"analog": 3}, {**used("ANALOG", 5), **analog_rate(100.0, INTEL)}, "ANALOG:USED"),
        ({"scale": 0.1}, {}, "POINT:SCALE"),
    ],
)
def test_what_fits_no_place_is_refused_by_name(tmp_path: Path, words: dict, extra: dict, named: str) -> None:
    file = C3D(smooth(200, 9), analog=np.ones((200, 1)), extra=extra, tail=b"bytes that nobody expects" * 99)
    (tmp_path / "take.c3d").write_bytes(spoiled(file, **words))
    with pytest.raises(FormatError, match=named):
        c3d.read(tmp_path / "take.c3d", ReadOptions())


# Rotations


def rotations(count: int, block: int) -> dict[str, Parameter]:
    return {
        "R:USED": ("ROTATION", "USED", 2, (), shorts([count], INTEL)),
        "R:START": ("ROTATION", "DATA_START", 2, (), shorts([block], INTEL)),
    }


def test_rotations_behind_the_points_are_no_frames(tmp_path: Path) -> None:
    file = C3D(smooth(70, 6), extra=rotations(3, 1), tail=np.ones(70 * 3 * 17, "<f4").tobytes())
    size = len(file.build()) - len(file.tail)
    file.extra = rotations(3, size // 512 + 1)  # type: ignore[assignment]
    take = load(tmp_path, file)
    assert (len(take.positions), take.findings) == (70, ())


def test_a_file_of_rotations_is_refused_as_such(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="rotations of 4 segments and no points") as refused:
        load(tmp_path, C3D(np.zeros((9, 0, 4)), extra=rotations(4, 4), tail=bytes(9 * 4 * 68)))
    assert "analog" not in str(refused.value)


# Frame counts


def long_frames(count: int) -> dict[str, Parameter]:
    return {"LONG": ("POINT", "LONG_FRAMES", 4, (), floats([count], INTEL))}


def frames_of_16_bits(count: int) -> dict[str, Parameter]:
    return {"FRAMES": ("POINT", "FRAMES", 2, (), shorts([count], INTEL))}


@pytest.mark.parametrize("n_frames", [65_536, 70_001, 140_003])
@pytest.mark.parametrize("n_points", [1, 2])
def test_counts_that_are_all_at_their_limit_are_no_counts(tmp_path: Path, n_frames: int, n_points: int) -> None:
    points = walk(n_frames, n_points)
    take = load(tmp_path, C3D(points, is_float=False, extra=frames_of_16_bits(65_535)))
    np.testing.assert_allclose(take.positions, points[..., :3] * 0.1, rtol=1e-6)


@pytest.mark.parametrize("n_frames", [65_537, 70_001, 140_003])
def test_counts_that_wrapped_are_known_by_the_size(tmp_path: Path, n_frames: int) -> None:
    points, low = walk(n_frames, 3), n_frames % 65_536
    take = load(tmp_path, C3D(points, extra=frames_of_16_bits(low), last_frame=low))
    np.testing.assert_array_equal(take.positions, points[..., :3])


@pytest.mark.parametrize("extra", [trial(1, 70_000), long_frames(70_000)], ids=["TRIAL", "LONG_FRAMES"])
@pytest.mark.parametrize("last_frame", [65535, 70_000 % 65536], ids=["saturated", "wrapped"])
def test_more_than_65535_frames(tmp_path: Path, extra: dict, last_frame: int) -> None:
    points = walk(70_000, 2)
    take = load(tmp_path, C3D(points, extra=extra, last_frame=last_frame))
    np.testing.assert_array_equal(take.positions, points[..., :3])


def test_a_trial_may_start_beyond_16_bits(tmp_path: Path) -> None:
    take = load(tmp_path, C3D(walk(), first_frame=100_001, extra=trial(100_001, 100_040)))
    assert (take.first_frame, len(take.positions)) == (100_001, 40)


def test_the_claim_that_fits_the_file_is_true(tmp_path: Path) -> None:
    take = load(tmp_path, C3D(walk(), extra={**long_frames(4000), **trial(1, 7)}, first_frame=5))
    assert (take.first_frame, len(take.positions)) == (5, 40)
    assert rules(take) == {"layout"}


def test_a_file_cut_inside_a_frame_is_refused(tmp_path: Path) -> None:
    whole = C3D(walk(400)).build()
    with pytest.raises(FormatError, match=r"byte \d+: the file must hold all its frames"):
        load(tmp_path, whole[:-1700])


@pytest.mark.parametrize("last_frame", [65535, 70_000 % 65536], ids=["saturated", "wrapped"])
def test_a_long_file_cut_off_is_not_taken_for_a_short_one(tmp_path: Path, last_frame: int) -> None:
    file = C3D(walk(70_000, 2), extra=trial(1, 70_000), last_frame=last_frame)
    with pytest.raises(FormatError, match="must hold all its frames"):
        load(tmp_path, file.build()[: file.data_start() + 66_000 * 32 + 9])


def test_a_file_cut_between_frames_is_read_and_told(tmp_path: Path) -> None:
    file = C3D(walk(400))
    take = load(tmp_path, file.build()[: file.data_start() + 300 * 80])
    assert len(take.positions) == 300
    (finding,) = take.findings
    assert (finding.rule, finding.level) == ("layout", "warning")


def test_more_bytes_than_frames_are_told_and_kept(tmp_path: Path) -> None:
    take = load(tmp_path, C3D(walk(), tail=b"an unknown block" * 100))
    assert (len(take.positions), rules(take)) == (40, {"layout"})
    written = c3d.write(fill(take, (0, 0)), tmp_path / "out.c3d")
    c3d.prove(written, tmp_path / "out.c3d")
    assert (tmp_path / "out.c3d").read_bytes().endswith(b"an unknown block" * 100)


def test_no_points_and_no_frames_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="The file has only analog"):
        load(tmp_path, C3D(np.zeros((9, 0, 4)), analog=np.ones((9, 4))))
    with pytest.raises(FormatError, match="must have frames"):
        load(tmp_path, C3D(np.zeros((0, 3, 4)), tail=bytes(10)))


def test_absurd_counts_cost_nothing(tmp_path: Path) -> None:
    huge = ("POINT", "LABELS", -1, (255,) * 60, b"")
    take = load(tmp_path, C3D(walk(), extra={"LABELS": huge, "HUGE": ("POINT", "ANGLES", 4, (255,) * 200, b"")}))
    assert take.origin is not None
    assert take.origin.document.n_points == 5
    whole = bytearray(C3D(walk(), extra={"USED": None, "LABELS": None}).build())
    whole[2:6] = b"\xff\xff\xff\xff"
    tracemalloc.start()
    try:
        with pytest.raises(FormatError, match="must have frames"):
            load(tmp_path, bytes(whole))
        assert tracemalloc.get_traced_memory()[1] < 30e6
    finally:
        tracemalloc.stop()
