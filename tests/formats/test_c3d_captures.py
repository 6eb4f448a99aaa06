"""C3D: real captures, damaged files and the independent witness ezc3d."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from c3d_builder import C3D, ENCODINGS, walk
from c3d_takes import differing, fill, load, trial
from conftest import capture_files
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from mocapclean.errors import FormatError
from mocapclean.formats import c3d
from mocapclean.take import ReadOptions

CAPTURES = capture_files("c3d")
NO_POINTS = {
    "BTKData__others_1123x01EMG.c3d",
    "c3dio__sample_35_Mega_Electronics_Isokinetic_EMG_Angle_Torque_Sample_File.c3d",
    "ezc3d-testFiles__Kistler.c3d",
}
# ezc3d takes other numbers of points or analog channels than the headers and the sizes of these files say
MISREAD_BY_EZC3D = {
    "BTKData__others_561xxa01_anonym.C3D",
    "c3dio__sample_27_kyowadengyo.c3d",
    "c3dio__sample_28_standing.C3D",
}
EZC3D_TIME_LIMIT = 60
EZC3D_READER = """
import sys
import ezc3d, numpy
for number, path in enumerate(sys.argv[2:]):
    print(path, flush=True)
    try:
        file = ezc3d.c3d(path)
    except (OSError, RuntimeError, ValueError, IndexError):
        continue
    if file["data"]["points"].size:
        numpy.save(f"{sys.argv[1]}/{number}.npy", file["data"]["points"][:3].transpose(2, 1, 0))
"""


SEEDS = [
    C3D(walk(12, 3), machine, is_float, analog=np.ones((12, 2)), extra=trial(1, 12)).build()
    for machine, is_float in ENCODINGS
]


@given(
    seed=st.integers(0, len(SEEDS) - 1),
    flips=st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), max_size=6),
    cut=st.none() | st.integers(0, 3000),
)
@example(seed=0, flips=[(2, 255), (3, 255), (4, 255), (5, 255)], cut=None)
@settings(max_examples=3000, deadline=5000, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damage_gives_a_take_or_a_format_error(
    tmp_path: Path, seed: int, flips: list[tuple[int, int]], cut: int | None
) -> None:
    content = bytearray(SEEDS[seed])
    for place, value in flips:
        content[place % len(content)] = value
    try:
        take = load(tmp_path, bytes(content[:cut]))
    except FormatError:
        return
    assert np.isfinite(take.positions[take.trusted]).all()
    assert take.positions.nbytes <= 3 * len(content)


@pytest.mark.parametrize("fragment", [b"\1\1A\1\0", b"\x01\x01A\xff\xff\x04\x00", b"\x7f\x7f" * 40, b"\1\xffA\0\0\0"])
def test_a_megabyte_of_nonsense_parameters_ends_soon(tmp_path: Path, fragment: bytes) -> None:
    nonsense = (b"\1P\0T" + fragment * (1_200_000 // len(fragment))).ljust(1_200_128, b"\0")
    header = bytearray(C3D(walk()).build()[:512])
    header[16:18] = (2500).to_bytes(2, "little")
    started = time.monotonic()
    with pytest.raises(FormatError):
        load(tmp_path, bytes(header) + nonsense)
    assert time.monotonic() - started < 5


# Real captures


@pytest.fixture(scope="module")
def witness(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, np.ndarray]:
    """The points of all captures that ezc3d reads, each batch in a process of its own that may crash or hang."""
    folder = tmp_path_factory.mktemp("ezc3d")
    found: dict[Path, np.ndarray] = {}
    paths = [path for path in CAPTURES if "bad_parameter_section" not in path.name]
    while paths:
        command = [sys.executable, "-c", EZC3D_READER, str(folder), *map(str, paths)]
        try:
            output = subprocess.run(command, capture_output=True, text=True, timeout=EZC3D_TIME_LIMIT).stdout
        except subprocess.TimeoutExpired as late:
            output = (late.stdout or b"").decode()
        n_done = len(output.splitlines())
        for number, path in enumerate(paths[:n_done]):
            points = folder / f"{number}.npy"
            if points.exists():
                found[path] = np.load(points)
                points.unlink()
        paths = paths[max(n_done, 1) :]
    return found


@pytest.mark.skipif(not CAPTURES, reason="the real captures are not at hand")
def test_captures_agree_with_ezc3d(witness: dict[Path, np.ndarray]) -> None:
    assert len(witness) > 0.8 * len(CAPTURES)
    for path in witness.keys() - {path for path in witness if path.name in MISREAD_BY_EZC3D}:
        take = c3d.read(path, ReadOptions())
        document = take.origin.document  # type: ignore[union-attr]
        stored = take.positions / (1000.0 if document.factor == 1000.0 else 1.0)
        expected = witness[path][: len(stored), document.marker_points()]
        assert expected.shape == stored.shape, path.name
        trusted = take.trusted
        np.testing.assert_allclose(stored[trusted], expected[trusted], rtol=1e-6, atol=1e-4, err_msg=path.name)
        missing = np.isnan(expected[~trusted]) | (expected[~trusted] == 0)
        assert missing.all(), path.name


@pytest.mark.parametrize("path", CAPTURES, ids=lambda path: path.stem)
def test_captures_come_out_as_they_went_in(tmp_path: Path, path: Path) -> None:
    if path.name in NO_POINTS:
        with pytest.raises(FormatError, match="must have points"):
            c3d.read(path, ReadOptions())
        return
    take = c3d.read(path, ReadOptions())
    out = tmp_path / "out.c3d"
    c3d.prove(c3d.write(take, out), out)
    assert out.read_bytes() == path.read_bytes()
    sample = len(take.positions) // 2, len(take.markers) // 3
    written = c3d.write(fill(take, sample, position=(12.5, -400.0, 1000.0)), out)
    c3d.prove(written, out)
    changed = differing(path.read_bytes(), out.read_bytes())
    assert 0 < len(changed) <= changed[-1] - changed[0] + 1 <= 16
    again = c3d.read(out, ReadOptions(points=take.markers))
    assert again.markers == take.markers
    np.testing.assert_array_equal(again.positions, written.positions)
    assert again.trusted[sample]
    np.testing.assert_allclose(again.positions[sample], (12.5, -400.0, 1000.0), atol=0.15)


@pytest.mark.skipif(not CAPTURES, reason="the real captures are not at hand")
@given(data=st.data())
@settings(max_examples=400, deadline=5000, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_captures_give_a_take_or_a_format_error(tmp_path: Path, data: st.DataObject) -> None:
    path = data.draw(st.sampled_from([path for path in CAPTURES if path.stat().st_size < 250_000]))
    content = bytearray(path.read_bytes())
    for place in data.draw(st.lists(st.integers(0, 4095), max_size=8)):
        content[place] = data.draw(st.integers(0, 255))
    cut = data.draw(st.none() | st.integers(0, len(content)))
    try:
        take = load(tmp_path, bytes(content[:cut]))
    except FormatError:
        return
    assert np.isfinite(take.positions[take.trusted]).all()
    assert take.positions.nbytes <= 3 * len(content)
