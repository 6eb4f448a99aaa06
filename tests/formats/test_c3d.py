"""C3D: what the words, parameters and points of every maker's file mean, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from c3d_builder import C3D, DEC, ENCODING_IDS, ENCODINGS, INTEL, MIPS, Parameter, floats, texts, walk
from c3d_takes import load, rules
from hypothesis import given, settings
from hypothesis import strategies as st

from mocapclean.errors import FormatError, UsageError
from mocapclean.formats import c3d
from mocapclean.formats.c3d.words import Words

# Words


@pytest.mark.parametrize(
    ("stored", "value"),
    [
        ("80400000", 1.0),
        ("80c00000", -1.0),
        ("00400000", 0.5),
        ("c8430000", 100.0),
        ("4941d00f", 3.14159),
        ("00000000", 0.0),
        ("7f00ffff", 0.0),
        ("00800000", np.nan),
        ("7f80ffff", np.nan),
    ],
    ids=["1", "-1", "0.5", "100", "pi", "zero", "dirty zero", "reserved", "reserved and dirty"],
)
def test_dec_words_are_those_of_the_vax(stored: str, value: float) -> None:
    words = Words(machine=DEC, is_float=True)
    raw = np.frombuffer(bytes.fromhex(stored), words.raw)
    np.testing.assert_allclose(words.decode(raw), [value], rtol=2e-7)
    if np.isfinite(value) and value:
        np.testing.assert_allclose(words.decode(words.encode(np.array([value]))), [value], rtol=2e-7)


@pytest.mark.parametrize(("machine", "is_float"), ENCODINGS, ids=ENCODING_IDS)
@given(values=st.lists(st.floats(-32767, 32767), min_size=1, max_size=20))
@settings(max_examples=50, deadline=None)
def test_a_word_holds_the_nearest_number(machine: int, is_float: bool, values: list[float]) -> None:
    words = Words(machine=machine, is_float=is_float)
    stored = words.decode(words.encode(np.array(values))).astype(float)
    tolerance = np.maximum(np.abs(values) * 2**-24, 1e-37) if is_float else 0.5
    assert (np.abs(stored - values) <= tolerance).all()
    np.testing.assert_array_equal(words.decode(words.encode(stored)), stored)


# Reading


@pytest.mark.parametrize(("machine", "is_float"), ENCODINGS, ids=ENCODING_IDS)
def test_every_encoding_reads_the_same(tmp_path: Path, machine: int, is_float: bool) -> None:
    points = walk()
    points[3, 1, 3] = -1
    file = C3D(points, machine, is_float, scale=0.25, first_frame=12, rate=119.88, analog=np.ones((40, 6)))
    take = load(tmp_path, file)
    np.testing.assert_array_equal(take.positions, points[..., :3] * (1.0 if is_float else 0.25))
    np.testing.assert_array_equal(np.argwhere(~take.trusted), [[3, 1]])
    assert take.markers == ("M1", "M2", "M3", "M4", "M5")
    assert take.rate == pytest.approx(119.88, rel=1e-7)
    assert take.first_frame == 12
    assert take.findings == ()
    assert not take.filled.any()


@pytest.mark.parametrize("machine", [INTEL, DEC, MIPS])
@pytest.mark.parametrize(
    "sample",
    [(5, 6, 7, -1), (0, 0, 0, 0), (0, 0, 0, -1), (0, -0.0, 0, 4), (np.nan, 1, 1, 0), (1, np.inf, 1, 0), (np.nan,) * 4],
    ids=str,
)
def test_every_way_of_writing_missing(tmp_path: Path, machine: int, sample: tuple[float, ...]) -> None:
    points = walk()
    points[2, 3] = sample
    take = load(tmp_path, C3D(points, machine))
    np.testing.assert_array_equal(np.argwhere(~take.trusted), [[2, 3]])
    assert np.isfinite(take.positions[take.trusted]).all()


@pytest.mark.parametrize("sample", [(0, 0, 1, 0), (5, 6, 7, 0), (-5, 0, 0, 258)], ids=str)
def test_what_is_not_missing(tmp_path: Path, sample: tuple[float, ...]) -> None:
    points = walk()
    points[2, 3] = sample
    assert load(tmp_path, C3D(points)).trusted.all()


def test_a_take_without_any_trust_says_so(tmp_path: Path) -> None:
    points = walk()
    points[...] = [0, 0, 0, -1]
    assert rules(load(tmp_path, C3D(points))) == {"missing"}


@pytest.mark.parametrize(
    ("units", "factor", "is_told"),
    [
        ("mm", 1, False),
        ("MM  ", 1, False),
        ("mm\0\0", 1, False),
        ("millimetres", 1, False),
        ("cm", 10, False),
        ("Centimeters", 10, False),
        ("m", 1000, False),
        ("M ", 1000, False),
        ("Meters", 1000, False),
        ("metre", 1000, False),
        ("mete", 1000, False),
        ("in", 25.4, False),
        ("Inches", 25.4, False),
        ("inch", 25.4, False),
        ("ft ", 304.8, False),
        ("FEET", 304.8, False),
        ("foot", 304.8, False),
        ("yards", 914.4, False),
        ("dm", 100, False),
        ("    ", 1, True),
        ("furlong", 1, True),
        (None, 1, True),
    ],
)
def test_units(tmp_path: Path, units: str | None, factor: float, is_told: bool) -> None:
    points = walk()
    take = load(tmp_path, C3D(points, units=units))
    np.testing.assert_array_equal(take.positions, points[..., :3] * factor)
    integers = load(tmp_path, C3D(points, is_float=False, scale=0.5, units=units))
    np.testing.assert_array_equal(integers.positions, points[..., :3] * 0.5 * factor)
    assert rules(take) == ({"units"} if is_told else set())


def test_labels_are_unique_and_never_empty(tmp_path: Path) -> None:
    labels = ["A", "A", "", "Bob:C7", "A", "A#2", "Größe", b"D\xe9but", "point3"]
    take = load(tmp_path, C3D(walk(n_points=10), labels=labels, extra={"LABELS": texts("POINT", "LABELS", labels)}))
    names = ("A", "A#3", "Bob:C7", "A#4", "A#2", "Größe", "Début", "point3", "point10")
    assert take.markers == names
    assert rules(take) == {"labels", "points"}
    assert load(tmp_path, C3D(walk(n_points=10), labels=labels), points=("point3#2",)).markers[2] == "point3#2"


def test_more_than_255_labels(tmp_path: Path) -> None:
    labels = [f"L{i:03}" for i in range(600)]
    assert load(tmp_path, C3D(walk(3, 600), labels=labels)).markers == tuple(labels)


def other_points(**lists: list[str]) -> dict[str, Parameter]:
    return {name: texts("POINT", name, labels) for name, labels in lists.items()}  # type: ignore[misc]


def test_points_that_are_no_markers_stay_out(tmp_path: Path) -> None:
    labels = ["C7", "Bob:Knee", "*12", "LASI", "Bob:*3", "Pow", "Ann:Knee", "Refl", "Bob:Pull"]
    extra = other_points(
        ANGLES=["Bob:Knee"], POWERS=["Joe:Pow", "Pull"], TYPE_GROUPS=["REFL", "Reflections"], REFL2=["Refl"]
    )
    extra["TYPE_GROUPS"] = ("POINT", "TYPE_GROUPS", -1, (4, 2, 1), b"REFLrefl")
    extra["REFL"] = texts("POINT", "REFL", ["nobody"])
    points = walk(n_points=9)
    file = C3D(points, labels=labels, extra=extra)
    take = load(tmp_path, file)
    assert take.markers == ("C7", "LASI", "Ann:Knee")
    np.testing.assert_array_equal(take.positions, points[:, [0, 3, 6], :3])
    (finding,) = take.findings
    assert finding.rule == "points"
    assert finding.message.startswith("6 of 9 points")
    assert load(tmp_path, file, points=("*12", "Bob:Knee")).markers == ("C7", "Bob:Knee", "*12", "LASI", "Ann:Knee")


def test_only_unlabelled_points_are_markers(tmp_path: Path) -> None:
    assert load(tmp_path, C3D(walk(), labels=[f"*{i}" for i in range(5)])).markers == ("*0", "*1", "*2", "*3", "*4")


def test_only_angles_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="must have markers"):
        load(tmp_path, C3D(walk(n_points=1), labels=["Knee"], extra=other_points(ANGLES=["Knee"])))


def test_an_unknown_point_names_its_neighbours(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"Got 'KneeAngle'\. Near it: LKneeAngles"):
        load(tmp_path, C3D(walk(n_points=2), labels=["C7", "LKneeAngles"]), points=("KneeAngle",))


@pytest.mark.parametrize("rate", [0.0, -50.0, np.nan, np.inf])
def test_an_unusable_rate_is_refused_unless_given(tmp_path: Path, rate: float) -> None:
    with pytest.raises(FormatError, match="--rate"):
        load(tmp_path, C3D(walk(), rate=rate))
    assert load(tmp_path, C3D(walk(), rate=rate), rate=59.94).rate == 59.94


def test_the_header_stands_in_for_a_missing_rate_and_scale(tmp_path: Path) -> None:
    points = walk()
    take = load(tmp_path, C3D(points, is_float=False, rate=65.5, extra={"RATE": None, "SCALE": None}))
    assert take.rate == 65.5
    np.testing.assert_allclose(take.positions, points[..., :3] * 0.1, rtol=1e-6)


def test_conflicting_scales_and_rates_are_told(tmp_path: Path) -> None:
    extra = {
        "SCALE": ("POINT", "SCALE", 4, (), floats([0.5], INTEL)),
        "RATE": ("POINT", "RATE", 4, (), floats([50.0], INTEL)),
    }
    take = load(tmp_path, C3D(walk(), is_float=False, extra=extra))  # type: ignore[arg-type]
    assert rules(take) == {"scale", "rate"}
    assert take.rate == 50.0


# Damaged and odd headers


def test_a_wrong_parameter_pointer_is_found_again(tmp_path: Path) -> None:
    for pointer in (0, 1, 3, 77, 255):
        assert load(tmp_path, C3D(walk(), pointer=pointer)).markers == ("M1", "M2", "M3", "M4", "M5")


def test_records_without_next_pointers_are_read(tmp_path: Path) -> None:
    assert load(tmp_path, C3D(walk(), link=False, labels=list("ABCDE"))).markers == tuple("ABCDE")


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"", "Got a file of 0 bytes"),
        (b"\x02P" + bytes(100), "Got a file of 102 bytes"),
        (b"Frame,X,Y,Z\n" * 100, "Got 0x72"),
        (b"\x02P" + bytes(510), "processor"),
        (b"\x02P" + bytes(2000), "processor"),
    ],
)
def test_what_is_no_c3d_is_refused(tmp_path: Path, content: bytes, match: str) -> None:
    with pytest.raises(FormatError, match=match) as caught:
        load(tmp_path, content)
    assert caught.value.byte is not None


def test_sniff() -> None:
    assert c3d.sniff(C3D(walk()).build()[:512])
    assert not c3d.sniff(b"\x02P" + bytes(100))
    assert not c3d.sniff(b"XP is text " * 60)
    assert not c3d.sniff(b"HIERARCHY\n" * 60)
