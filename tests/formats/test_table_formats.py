"""Tables of text: what is read of each maker's files, what a repair leaves, and what is refused."""

import dataclasses

import numpy as np
import pytest
import table_texts as texts
from hypothesis import given
from hypothesis import strategies as st

import mocapclean
from mocapclean import formats
from mocapclean.errors import FormatError, UsageError
from mocapclean.formats.tables.lines import cells, names_of, spans_at
from mocapclean.formats.tables.numbers import NumberStyle, style_of
from tests.conftest import SAMPLES

RESOLUTION = {"trc_crlf_nan_m.trc": 1e-4, "motive.csv": 1e-3, "nexus.csv": 0.01, "nexus_alone.csv": 0.01}
"""Millimetres of the last decimal of files that are coarser than a thousandth of a millimetre."""


@pytest.fixture
def saved(tmp_path):
    """A function that saves a text and returns its path."""

    def save(content, name="take.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return save


def filled(take, value=(123.4564, -7.0, 1000.0)):
    """The take with all its missing samples filled with one position."""
    positions = take.positions.copy()
    positions[~take.trusted] = value
    return dataclasses.replace(take, positions=positions, filled=~take.trusted)


@pytest.mark.parametrize("name", texts.TEXTS)
def test_the_motion_is_read_from_the_files_of_all_makers(name, saved):
    take = mocapclean.read(saved(texts.TEXTS[name], name))
    expected = texts.motion()
    assert [marker.rpartition(":")[2] for marker in take.markers] == list(texts.NAMES)
    np.testing.assert_array_equal(take.trusted, np.isfinite(expected[..., 0]))
    error = np.abs(take.positions - expected)[take.trusted].max()
    assert error <= RESOLUTION.get(name, 1e-3)
    assert take.rate == texts.RATE
    assert take.origin.format == name.split("_")[0].split(".")[0].replace("plain", "csv")


@pytest.mark.parametrize("name", texts.TEXTS)
def test_a_fill_changes_the_cells_of_its_samples_alone(name, saved, tmp_path):
    path = saved(texts.TEXTS[name], name)
    take = mocapclean.read(path)
    out = tmp_path / f"out{path.suffix}"
    written = mocapclean.write(filled(take), out)
    codec = "utf-16" if "wide" in name else "latin-1"
    before, after = (p.read_bytes().decode(codec).splitlines() for p in (path, out))
    assert len(before) == len(after)
    different = [i for i, (old, new) in enumerate(zip(before, after, strict=True)) if old != new]
    assert len(different) == 5  # the frames of the gap
    for i in different:
        mark = next(mark for mark in ("\t", ";", ",", " ") if mark in before[i])
        old, new = before[i].split(mark), after[i].split(mark)
        assert sum(a != b for a, b in zip(old, new, strict=True)) == 3
    np.testing.assert_allclose(written.positions[written.filled], mocapclean.read(out).positions[written.filled])
    np.testing.assert_allclose(written.positions[written.filled][0], (123.4564, -7.0, 1000.0), atol=0.51e-2)


@pytest.mark.parametrize(
    ("name", "cell"),
    [
        ("trc.trc", b"\t123.45640\t-7.00000\t1000.00000\t"),
        ("trc_crlf_nan_m.trc", b"\t0.1234564\t-0.0070000\t1.0000000\t"),
        ("motive.csv", b",0.123456,-0.007000,1.000000,"),
        ("nexus.csv", b",123.456,-7,1000,"),
        ("qualisys.tsv", b"\t123.456\t-7.000\t1000.000\t"),
        ("plain_semicolon.csv", b";123,4564;-7,0000;1000,0000;"),
    ],
)
def test_a_number_is_spelled_as_the_file_spells_its_own(name, cell, saved, tmp_path):
    path = saved(texts.TEXTS[name], name)
    mocapclean.write(filled(mocapclean.read(path)), tmp_path / f"out{path.suffix}")
    assert (tmp_path / f"out{path.suffix}").read_bytes().count(cell) == 5


@pytest.mark.parametrize(
    ("name", "mark"),
    [
        ("trc.trc", b"\t\t\t\t"),
        ("trc_space.trc", b" nan nan nan "),
        ("motive.csv", b",,,,"),
        ("qualisys.tsv", b"\t0.000\t0.000\t0.000\t"),
        ("qualisys_null.tsv", b"\tNULL\tNULL\tNULL\t"),
        ("plain_semicolon.csv", b";;;;"),
    ],
)
def test_a_sample_is_marked_missing_as_the_file_marks_its_own(name, mark, saved, tmp_path):
    path = saved(texts.TEXTS[name], name)
    take = mocapclean.read(path)
    trusted = take.trusted.copy()
    trusted[20, 1] = False
    mocapclean.write(dataclasses.replace(take, trusted=trusted), tmp_path / f"out{path.suffix}", invalidate=True)
    content = (tmp_path / f"out{path.suffix}").read_bytes()
    assert content.count(mark) == path.read_bytes().count(mark) + 1
    np.testing.assert_array_equal(mocapclean.read(tmp_path / f"out{path.suffix}").trusted, trusted)


def test_another_cell_of_a_filled_row_is_not_proven(saved, tmp_path):
    take = mocapclean.read(saved(texts.trc(), "take.trc"))
    out = tmp_path / "out.trc"
    written = mocapclean.write(filled(take), out)
    lines = out.read_bytes().splitlines(keepends=True)
    row = lines[6 + 10]
    for wrong in (row.replace(b"123.45640", b"123.45641"), row.replace(b"0.100", b"0.101"), b"1\n"):
        out.write_bytes(b"".join([*lines[:16], wrong, *lines[17:]]))
        with pytest.raises(FormatError, match=r"must (stay|read back) as"):
            formats.FORMATS["trc"].prove(written, out)


def test_a_fill_at_the_origin_is_left_out(saved, tmp_path):
    path = saved(texts.trc(), "take.trc")
    written = mocapclean.write(filled(mocapclean.read(path), (0.0, -1e-9, 0.0)), tmp_path / "out.trc")
    assert not written.filled.any()
    assert "0, 0, 0, which means missing" in written.findings[-1].message
    assert (tmp_path / "out.trc").read_bytes() == path.read_bytes()


def test_what_a_maker_computes_is_carried_along(saved):
    motive = mocapclean.read(saved(texts.motive()))
    assert formats.carried(motive) == ("Shank", "Shank:Marker1", "Unlabeled 1203")
    both = mocapclean.read(motive.origin.path, points=["Shank"])
    assert "Shank" in both.markers
    body = texts.motive().replace(b"Rigid Body Marker", b"Bone").replace(b",Marker", b",Rigid Body Marker")
    assert mocapclean.read(saved(body, "computed.csv")).markers[1:3] == ("Shank:Marker1", "S:LANK")


def test_events_are_read_and_written(saved, tmp_path):
    nexus = mocapclean.read(saved(texts.nexus()))
    found = [(event.context, event.label, round(event.frame, 6)) for event in formats.events(nexus)]
    assert found == [("Right", "Foot Off", 5.0), ("Left", "Foot Strike", 10.0)]
    for name in ("out.c3d", "out.tsv"):
        mocapclean.write(nexus, tmp_path / name)
        frames = [event.frame for event in formats.events(mocapclean.read(tmp_path / name))]
        np.testing.assert_allclose(frames, [5.0, 10.0], atol=1e-3)
    (jump,) = formats.events(mocapclean.read(saved(texts.qualisys(first=31), "q.tsv")))
    assert (jump.label, jump.frame) == ("Jump", 12.0)


def test_a_table_of_numbers_alone_needs_a_rate(saved):
    path = saved(texts.qualisys(header=False, titles=False), "numbers.tsv")
    with pytest.raises(FormatError, match="give it with --rate"):
        mocapclean.read(saved(texts.qualisys(header=False, titles=False, lead=0), "bare.tsv"))
    take = mocapclean.read(path)
    assert take.markers[:2] == ("point1", "point2")
    assert take.rate == texts.RATE
    assert mocapclean.read(path.with_name("bare.tsv"), rate=50.0).rate == 50.0


@pytest.mark.parametrize(
    "text", [texts.qualisys(header=False), texts.qualisys(header=False, lead=0).replace(b" X", b"_X")]
)
def test_titles_are_enough_for_qualisys(text, saved):
    take = mocapclean.read(saved(text, "titled.tsv"), rate=texts.RATE)
    assert take.trusted.shape == (texts.N_FRAMES, len(texts.NAMES))


@pytest.mark.parametrize(
    "pattern",
    [
        "{name}_{axis}",
        "{name}.{axis}",
        "{name}:{axis}",
        "{name} {axis}",
        "{axis}_{name}",
        "{name}-{axis}",
        "{name}_{axis} (mm)",
    ],
)
def test_columns_are_known_by_their_names(pattern, saved):
    assert mocapclean.read(saved(texts.plain(pattern=pattern))).markers == texts.NAMES


def test_three_axes_alone_are_no_position(saved):
    table = texts.plain().splitlines()
    more = b",hip_rot_x,hip_rot_y,hip_rot_z,q_x,q_y,q_z,q_w,handVelocity_x,handVelocity_y,handVelocity_z"
    wide = [table[0] + more, *(line + b",1.5,2.5,3.5,0.1,0.2,0.3,0.9,4.5,5.5,6.5" for line in table[1:])]
    take = mocapclean.read(saved(b"\n".join([*wide, b""])))
    assert take.markers == texts.NAMES
    assert formats.carried(take) == ("hip_rot", "q", "handVelocity")
    with pytest.raises(FormatError, match="must be a take of"):
        mocapclean.read(saved("time,acc_x,acc_y,acc_z\n0,1,2,3\n0.01,1,2,3\n"))


def test_names_can_be_in_a_line_above_the_axes(saved):
    text = "bodyparts,nose,nose,nose,tail,tail,tail\ncoords,x,y,z,x,y,z\n0,1.5,2,3,40,5,6\n1,1.6,2.5,3,40,5,6.5\n"
    take = mocapclean.read(saved(text), rate=30.0)
    assert take.markers == ("nose", "tail")
    np.testing.assert_array_equal(take.positions[1, 1], [40.0, 5.0, 6.5])


@pytest.mark.parametrize("stamp", ["2024-03-05 10:11:{:05.2f}", "17096334{:05.2f}", '"10:11:{:05.2f}"'])
def test_dates_are_carried_along(stamp, saved, tmp_path):
    lines = texts.plain(lead=("frame",)).decode().splitlines()
    rows = [f"{stamp.format(i / 100)},{line}" for i, line in enumerate(lines[1:])]
    path = saved("\n".join([f"timestamp,{lines[0]}", *rows, ""]))
    with pytest.raises(FormatError, match="give it with --rate"):
        mocapclean.read(path)
    take = mocapclean.read(path, rate=texts.RATE)
    assert take.markers == texts.NAMES
    assert "other columns: 7" in take.origin.document.others
    mocapclean.write(filled(take), tmp_path / "out.csv")
    assert [row.split(",")[0] for row in (tmp_path / "out.csv").read_text().splitlines()[1:]] == [
        row.split(",")[0] for row in rows
    ]


@pytest.mark.parametrize(("unit", "factor"), [("(m)", 1000.0), ("[cm]", 10.0), ("(mm)", 1.0)])
def test_the_unit_of_the_titles_counts(unit, factor, saved):
    take = mocapclean.read(saved(texts.plain(pattern="{name}_{axis} " + unit)))
    np.testing.assert_allclose(take.positions[0], factor * texts.motion()[0], atol=1e-4 * factor)
    assert [finding.level for finding in take.findings if finding.rule == "units"] == ["info"]


def test_a_body_of_two_units_is_taken_in_metres_with_a_warning(saved):
    text = "frame,time,a_x,a_y,a_z,b_x,b_y,b_z\n0,0,0.1,0.2,1.7,0.1,0.2,0.1\n1,0.02,0.1,0.2,1.7,0.1,0.2,0.1\n"
    take = mocapclean.read(saved(text))
    assert take.positions[0, 0, 2] == 1700.0
    (finding,) = [finding for finding in take.findings if finding.rule == "units"]
    assert finding.level == "warning"
    assert "1000 mm is assumed" in finding.message
    assert mocapclean.read(saved(text), unit=10.0).positions[0, 0, 2] == 17.0


@pytest.mark.parametrize("codec", ["utf-8", "latin-1", "cp932", "utf-16"])
def test_the_encoding_of_the_file_stays(codec, saved, tmp_path):
    name = {"cp932": "左足", "latin-1": "Füße"}.get(codec, "Füße左")
    path = saved(texts.plain(eol="\r\n").decode().replace("LANK", name).encode(codec))
    take = mocapclean.read(path)
    assert take.markers[0] == name
    mocapclean.write(filled(take), tmp_path / "out.csv")
    content = (tmp_path / "out.csv").read_bytes()
    assert content.decode(codec).splitlines()[0] == path.read_bytes().decode(codec).splitlines()[0]


REFUSED = {
    "cut off": (texts.trc()[:-30], "take.trc", r"line 46: a frame must have at least 20 cells"),
    "word": (texts.trc().replace(b"0.100\t", b"0.100\tx"), "take.trc", r"line 17: a cell must be a decimal number"),
    "blank line": (texts.trc().replace(b"\n9\t", b"\n\n9\t"), "take.trc", r"line 15: a line between frames must not"),
    "frames": (texts.trc().replace(b"\n9\t", b"\n8\t"), "take.trc", r"line 15: frame numbers must be whole and evenly"),
    "no frames": (b"".join(texts.trc().splitlines(keepends=True)[:6]), "take.trc", r"a take must have frames"),
    "no names": (b"PathFileType\t4\n" + b"DataRate\n" * 5, "take.trc", r"line 4: the names of the markers must follow"),
    "count": (texts.trc().replace(b"\t6\tmm", b"\tsix\tmm"), "take.trc", r"NumMarkers must be a whole number"),
    "few names": (texts.trc().replace(b"\tC7", b"\t"), "take.trc", r"5 names above 18 coordinates"),
    "word in a plain table": (texts.plain().replace(b"0.0900,", b"0.0900,x"), "take.csv", r"line 11: a cell must be"),
    "no rate": (texts.trc().replace(b"100.00", b"0").replace(b"\t0.", b"\t-0."), "take.trc", r"give it with --rate"),
    "absurd rate": (texts.trc().replace(b"100.00", b"1e300"), "take.trc", r"frame rate must be 0.001 to 1e\+06 Hz"),
    "steep times": ("time,A_x,A_y,A_z\n0,1,2,3\n1e-320,1,2,3\n", "take.csv", r"frame rate must be 0.001 to 1e\+06 Hz"),
    "other content": (b"HIERARCHY\n", "take.trc", r"the content is not TRC"),
    "binary": (b"PathFileType\t4\0", "take.trc", r"the content is not TRC"),
    "rigid bodies": (b"NO_OF_FRAMES\t2\nDATA_INCLUDED\t6D\nBODY_NAMES\tA\n", "take.tsv", r"must have 3D positions"),
    "few cells": (
        texts.qualisys(titles=False).replace(b"\tC7\r", b"\tC7\tT1\tT2\r"),
        "take.tsv",
        r"three cells for each",
    ),
    "no markers": (texts.nexus().split(b"Trajectories")[0], "take.csv", r"a section 'Trajectories' must hold"),
    "two units": (texts.nexus().replace(b",mm,mm,mm,mm\r", b",mm,mm,mm,m\r"), "take.csv", r"must have one unit"),
    "no positions": (texts.motive().replace(b"Position", b"Velocity"), "take.csv", r"columns of positions"),
    "other table": (b"kind,marker,first,last\nspike,C7,1,2\n", "take.csv", r"must be a take of one of the formats"),
    "slow": (texts.plain(lead=("time_ms",)).replace(b"time_ms", b"time"), "take.csv", r"times that do not tell it"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_input_is_refused_with_its_place(case, saved):
    content, name, message = REFUSED[case]
    with pytest.raises(FormatError, match=message):
        mocapclean.read(saved(content, name))


FOUND = {
    "frames": (texts.trc(n_frames=900), "take.trc", "the header states 900 frames, the file has 40"),
    "markers": (texts.trc().replace(b"\t6\tmm", b"\t7\tmm"), "take.trc", "NumMarkers is 7, but 6 markers are named"),
    "rate": (texts.trc().replace(b"100.00", b"120.00"), "take.trc", "the rate is 120 Hz, but the times tell 100 Hz"),
    "camera": (texts.trc().replace(b"100.00\t100.00", b"0\t100.00", 1), "take.trc", "CameraRate, 100 Hz, was used"),
    "unit": (texts.trc().replace(b"\tmm\t", b"\tell\t"), "take.trc", "Units must be a unit of length. Got 'ell'"),
    "uneven": (texts.plain().replace(b"0.0900", b"0.0980"), "take.csv", "the times are uneven"),
    "names": (texts.trc().replace(b"RANK", b"LANK"), "take.trc", "repeated labels got a new name: LANK#2"),
}


@pytest.mark.parametrize("case", FOUND)
def test_what_is_odd_is_read_and_told(case, saved):
    content, name, message = FOUND[case]
    take = mocapclean.read(saved(content, name))
    assert any(message in finding.message for finding in take.findings), [f.message for f in take.findings]


def test_samples_can_be_left_out_at_the_end_of_a_row(saved, tmp_path):
    lines = texts.trc(end="").splitlines(keepends=True)
    lines[20] = lines[20].rsplit(b"\t", 3)[0] + b"\n"
    path = saved(b"".join(lines), "take.trc")
    take = mocapclean.read(path)
    assert not take.trusted[20 - 6, 5]
    assert take.trusted[20 - 6, :5].sum() == 4
    mocapclean.write(take, tmp_path / "same.trc")
    assert (tmp_path / "same.trc").read_bytes() == path.read_bytes()
    mocapclean.write(filled(take), tmp_path / "out.trc")
    assert (tmp_path / "out.trc").read_bytes().splitlines()[20].endswith(b"\t123.45640\t-7.00000\t1000.00000")


def test_samples_that_are_left_out_are_marked_by_blanks(saved, tmp_path):
    lines = texts.trc().splitlines(keepends=True)
    lines[8] = lines[8].rsplit(b"\t", 3)[0] + b"\n"
    take = mocapclean.read(saved(b"".join(lines), "take.trc"))
    trusted = take.trusted.copy()
    trusted[20, 1] = False
    mocapclean.write(dataclasses.replace(take, trusted=trusted), tmp_path / "out.trc", invalidate=True)
    assert b"\t\t\t\t" in (tmp_path / "out.trc").read_bytes().splitlines()[26]


def test_a_point_without_a_name_leaves_the_names_of_the_others(saved):
    lines = texts.trc().replace(b"LKNE", b"").splitlines(keepends=True)
    lines[6] = lines[6].rsplit(b"\t", 3)[0] + b"\t\t\t\n"  # the last marker is missing in the first frame
    take = mocapclean.read(saved(b"".join(lines), "take.trc"))
    assert take.markers == ("LANK", "RANK", "RKNE", "STRN", "C7")
    assert formats.carried(take) == ("point3",)
    np.testing.assert_allclose(take.positions[1], np.delete(texts.motion()[1], 2, axis=0), atol=1e-5)


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_nexus_with_other_delimiters_has_the_same_rate_and_events(delimiter, saved):
    english = mocapclean.read(saved(texts.nexus()))
    content = texts.nexus().decode().replace(",", delimiter).replace("\r\n100\r\n", "\r\n100.5\r\n")
    take = mocapclean.read(saved(content.replace(".", ",") if delimiter == ";" else content, "other.csv"))
    assert take.rate == 100.5
    found, expected = ([(e.label, e.context) for e in formats.events(t)] for t in (take, english))
    assert found == expected


def test_labels_of_events_keep_their_letters(saved, tmp_path):
    qualisys = mocapclean.read(saved(texts.qualisys().replace(b"Jump", "Füße 左".encode()), "q.tsv"))
    mocapclean.write(qualisys, tmp_path / "out.csv", format="nexus")
    for take in (qualisys, mocapclean.read(tmp_path / "out.csv")):
        assert [event.label for event in formats.events(take)] == ["Füße 左"]


def test_titles_below_a_long_line_of_names_are_found(saved):
    names = [f"a rather long name of a marker {i}" for i in range(300)]
    lines = ["," + ",,,".join(names), "time" + ",x,y,z" * 300, *(t + ",1,2,3" * 300 for t in ("0", "0.01"))]
    assert mocapclean.read(saved("\n".join(lines))).markers == tuple(names)


def test_the_header_of_a_new_table_has_the_name_of_the_take(saved, tmp_path):
    take = mocapclean.read(saved(texts.qualisys(), "Jump 3.tsv"))
    mocapclean.write(take, tmp_path / "out.trc")
    mocapclean.write(take, tmp_path / "out.csv", format="motive")
    assert (tmp_path / "out.trc").read_bytes().splitlines()[0].endswith(b"\tJump 3.trc")
    assert b",Take Name,Jump 3," in (tmp_path / "out.csv").read_bytes()


def test_one_frame_is_not_enough_for_a_plain_table(tmp_path):
    take = mocapclean.read(SAMPLES / "walk.c3d").crop(0, 1)
    with pytest.raises(UsageError, match=r"out\.csv: a plain table tells the rate"):
        mocapclean.write(take, tmp_path / "out.csv")


def test_axes_in_small_letters_are_axes(saved):
    small = texts.trc().replace(b"X1\tY1\tZ1", b"x1\ty1\tz1")
    assert mocapclean.read(saved(small, "take.trc")).trusted.shape == (texts.N_FRAMES, len(texts.NAMES))


@pytest.mark.parametrize("name", ["out.trc", "out.c3d"])
def test_an_error_has_the_name_of_the_output(name, saved, tmp_path):
    take = mocapclean.read(saved(texts.trc(), "take.trc"))
    with pytest.raises(FormatError) as refused:
        mocapclean.write(filled(take, (np.inf, 0.0, 0.0)), tmp_path / name)
    assert str(refused.value).startswith(f"{tmp_path / name}, frame 11, marker LKNE: ")
    assert (refused.value.path, refused.value.frame) == (tmp_path / name, 11)


def test_zeros_are_missing_and_told(saved):
    take = mocapclean.read(saved(texts.trc(missing="0.00000"), "take.trc"))
    assert not take.trusted[texts.GAP].any()
    assert any(finding.message.endswith("read as missing: 5") for finding in take.findings)


def test_a_version_number_may_come_first_and_analog_data_are_no_take(saved):
    assert mocapclean.read(saved(b"FILE_VERSION\t2.0.0\r\n" + texts.qualisys(), "new.tsv")).rate == texts.RATE
    analog = saved(b"FILE_VERSION\t2.0.0\nTOT_NO_OF_CHAN\t1\nDATA_INCLUDED\tANALOG\n1\t2\t3\n", "take_a.tsv")
    assert not formats.is_take(analog)


def test_a_format_can_be_given(saved, tmp_path):
    path = saved(texts.nexus(), "take.txt")
    with pytest.raises(FormatError, match="must end in one of"):
        mocapclean.read(path)
    with pytest.raises(UsageError, match="the format must be one of"):
        mocapclean.read(path, format="fbx")
    take = mocapclean.read(path, format="nexus")
    mocapclean.write(filled(take), tmp_path / "out.txt")
    assert mocapclean.read(tmp_path / "out.txt", format="nexus").trusted.all()


def test_names_that_no_cell_holds_are_refused(saved, tmp_path):
    take = mocapclean.read(saved(texts.plain()))
    odd = dataclasses.replace(take, markers=("a,b", *take.markers[1:]), origin=None)
    with pytest.raises(UsageError, match="no delimiter"):
        mocapclean.write(odd, tmp_path / "out.trc")


@given(
    st.lists(st.floats(-9999, 9999).filter(lambda value: abs(value) >= 1e-3), min_size=2, max_size=30),
    st.sampled_from(["%.3f", "%.0f", "%.6g", "%.4e", "%r"]),
    st.booleans(),
)
def test_numbers_are_spelled_in_a_style_in_which_the_file_could_have_spelled_them(values, form, comma):
    tokens = [(form % value).encode() for value in values]
    style = style_of(tokens, comma)
    for value, token in zip(values, tokens, strict=True):
        spelled = style.spell(value)
        assert (b"," in spelled) <= comma
        if form != "%r":
            step = {"%.3f": 0.001, "%.0f": 1.0, "%.6g": 0.01, "%.4e": 0.1}[form]
            assert abs(style.value(spelled) - float(token)) <= step


@pytest.mark.parametrize(
    ("tokens", "style"),
    [
        ([b"1.20", b"-3.45"], NumberStyle("fixed", 2)),
        ([b"1.2", b"-3.45", b"300"], NumberStyle("trimmed", 2)),
        ([b"44.1628", b"-276.862", b"158"], NumberStyle("significant", 6)),
        ([b"1.000e+02", b"-2.500e-01"], NumberStyle("exponent", 3)),
        ([b"1000.25", b"1e-05", b"1e-06"], NumberStyle("fixed", 2)),
        ([b"", b"nan"], NumberStyle("fixed", 6)),
    ],
)
def test_the_style_of_numbers(tokens, style):
    assert style_of(tokens, False) == style


@given(st.lists(st.sampled_from(["", "a", " b ", '"c,d"', '""', '"e"', "1.5"]), min_size=1, max_size=8))
def test_spans_are_where_the_cells_are(parts):
    line = ",".join(parts).encode() + b"\r\n"
    found = cells(line, b",")
    assert len(found) == len(parts)
    spans = spans_at(line, b",", range(len(found)))
    assert [line[start:stop].strip() for start, stop in spans] == [cell.strip() for cell in found]


def test_names_share_one_encoding():
    assert names_of([b"\x8d\xb6", b"LANK"]) == ["左", "LANK"]
    assert names_of([b"F\xfc\xdfe"]) == ["Füße"]
    assert names_of(["Füße".encode()]) == ["Füße"]


@pytest.mark.parametrize("suffix", [".trc", ".tsv", ".csv"])
def test_labels_that_are_exchanged_back_keep_their_numbers(suffix, tmp_path):
    take = mocapclean.read(SAMPLES / "walk_truth.c3d").crop(0, 200)
    swapped, span = take.positions.copy(), slice(80, 120)
    first, second = take.markers.index("LANK"), take.markers.index("LTOE")
    swapped[span, [first, second]] = swapped[span, [second, first]]
    mocapclean.write(take, tmp_path / f"right{suffix}")
    mocapclean.write(dataclasses.replace(take, positions=swapped), tmp_path / f"wrong{suffix}")
    found = mocapclean.detect(mocapclean.read(tmp_path / f"wrong{suffix}"), fix_swaps=True)
    assert found.moved[span, first].all()
    mocapclean.write(found, tmp_path / f"out{suffix}")
    out, right = ((tmp_path / f"{name}{suffix}").read_bytes().splitlines() for name in ("out", "right"))
    assert out[6:] == right[6:]  # a TRC has its own name in its first line


@pytest.mark.parametrize(("name", "delimiter", "skipped"), [("trc", "\t", 6), ("csv", ",", 1), ("motive", ",", 7)])
def test_another_reader_finds_the_same_numbers_in_a_new_table(name, delimiter, skipped, tmp_path):
    take = mocapclean.read(SAMPLES / "walk.c3d").crop(0, 60)
    path = tmp_path / f"new{formats.DECLARATIONS[name].suffixes[0]}"
    mocapclean.write(take, path, format=name)
    table = np.genfromtxt(path, delimiter=delimiter, skip_header=skipped)
    np.testing.assert_array_equal(table[:, 0], np.arange(1, 61))
    np.testing.assert_allclose(table[:, 1], np.arange(60) / take.rate, atol=1e-6)
    expected = np.where(take.trusted[..., None], take.positions, np.nan)
    np.testing.assert_allclose(table[:, 2:].reshape(expected.shape), expected, atol=1e-6)
