"""Spans of joints and channels: CSV as people export it, names with wildcards, subtrees and subjects."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocapclean.detection.spans import Span, read_spans, spanned_channels
from mocapclean.errors import UsageError
from mocapclean.geometry.skeleton import Channel, Skeleton
from mocapclean.take.names import matching_channels, matching_joints

JOINTS = [
    ("Hips", -1, "tr"),
    ("Spine", 0, "r"),
    ("LeftArm", 1, "r"),
    ("LeftForeArm", 2, "r"),
    ("LeftHand", 3, ""),
    ("RightArm", 1, "r"),
    ("foot.L", 0, "r"),
]


def skeleton(subject: str = "") -> Skeleton:
    channels = []
    for joint, (_, _, kinds) in enumerate(JOINTS):
        channels += [Channel(joint=joint, axis=axis, is_rotation=False) for axis in range(3) if "t" in kinds]
        channels += [Channel(joint=joint, axis=axis, is_rotation=True) for axis in (2, 0, 1) if "r" in kinds]
    return Skeleton(
        names=tuple(subject + name for name, _, _ in JOINTS),
        parents=tuple(parent for _, parent, _ in JOINTS),
        before=np.ones((len(JOINTS), 3)),
        after=np.zeros((len(JOINTS), 3)),
        frames=np.broadcast_to(np.eye(3), (len(JOINTS), 3, 3)),
        channels=tuple(channels),
        product=tuple(index for index, channel in enumerate(channels) if channel.is_rotation),
    )


def named(pattern: str, subject: str = "") -> list[str]:
    """Return the names of the channels that a pattern gives, without the subject."""
    own = skeleton(subject)
    channels = [own.channels[index] for index in matching_channels(pattern, own)]
    return [f"{JOINTS[channel.joint][0]}.{channel.name}" for channel in channels]


def joints(pattern: str, subject: str = "") -> list[str]:
    return [JOINTS[joint][0] for joint in matching_joints(pattern, skeleton(subject))]


def span(name: str, first: int = 5, last: int = 7) -> Span:
    return Span(marker=name, first=first, last=last, place="bad.csv, line 1")


@pytest.mark.parametrize("subject", ["", "mixamorig:", "Set:Ann:"])
@pytest.mark.parametrize(
    ("pattern", "wanted"),
    [
        ("LeftArm", ["LeftArm"]),
        ("LeftArm/*", ["LeftArm", "LeftForeArm", "LeftHand"]),
        ("*Arm", ["LeftArm", "LeftForeArm", "RightArm"]),
        ("*Arm/*", ["LeftArm", "LeftForeArm", "LeftHand", "RightArm"]),
        ("Hips/*", [name for name, _, _ in JOINTS]),
        ("foot.L", ["foot.L"]),
        ("leftarm", []),
        ("Left", []),
        ("/*", []),
    ],
)
def test_patterns_match_joints_whatever_their_subject(pattern: str, wanted: list[str], subject: str) -> None:
    assert joints(pattern, subject) == wanted
    assert joints(subject + pattern, subject) == (joints(pattern) if pattern != "/*" else [])


def test_a_subject_that_no_joint_has_is_left_out() -> None:
    assert joints("mixamorig:LeftArm/*") == ["LeftArm", "LeftForeArm", "LeftHand"]
    assert joints("Bob:LeftArm", "Ann:") == []


@pytest.mark.parametrize(
    ("pattern", "wanted"),
    [
        ("LeftArm.Zrotation", ["LeftArm.Zrotation"]),
        ("LeftArm.zROTATION", ["LeftArm.Zrotation"]),
        ("LeftArm.rotation", ["LeftArm.Zrotation", "LeftArm.Xrotation", "LeftArm.Yrotation"]),
        ("LeftArm.*", ["LeftArm.Zrotation", "LeftArm.Xrotation", "LeftArm.Yrotation"]),
        ("Hips.translation", ["Hips.Xposition", "Hips.Yposition", "Hips.Zposition"]),
        ("Hips.Y*", ["Hips.Yposition", "Hips.Yrotation"]),
        ("LeftArm/*.Xrotation", ["LeftArm.Xrotation", "LeftForeArm.Xrotation"]),
        ("foot.L", ["foot.L.Zrotation", "foot.L.Xrotation", "foot.L.Yrotation"]),
        ("foot.L.Xrotation", ["foot.L.Xrotation"]),
        ("LeftArm.Xposition", []),
        ("LeftArm.", []),
        ("LeftHand", []),
    ],
)
def test_patterns_match_channels(pattern: str, wanted: list[str]) -> None:
    assert named(pattern) == wanted
    assert named(pattern, "Character1:") == wanted
    assert named("Character1:" + pattern, "Character1:") == wanted


@settings(max_examples=200, deadline=None, database=None)
@given(
    st.lists(
        st.tuples(st.sampled_from(["Hips", "LeftArm", "*Arm.Xrotation", "Spine/*"]), st.integers(0, 29)), min_size=1
    ),
    st.integers(-5, 1000),
)
def test_spans_mark_their_channels_in_their_frames_alone(rows: list[tuple[str, int]], first_frame: int) -> None:
    own, wanted = skeleton(), np.zeros((30, len(skeleton().channels)), dtype=bool)
    for name, frame in rows:
        wanted[np.ix_(range(frame, min(frame + 4, 30)), matching_channels(name, own))] = True
    spans = tuple(span(name, first_frame + at, first_frame + min(at + 3, 29)) for name, at in rows)
    np.testing.assert_array_equal(spanned_channels(spans, own, 30, first_frame), wanted)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (span("LeftArn"), r"bad\.csv, line 1: the take has no joint 'LeftArn'\. Near: LeftArm"),
        (span("leftarm/*"), r"no joint 'leftarm/\*'\. Near: LeftArm"),
        (span("LeftArn.Zrotation"), r"no joint 'LeftArn\.Zrotation'\. Near: LeftArm"),
        (span("LeftArm.Zposition"), r"joint 'LeftArm' has no channel 'Zposition'\. Its channels: Zrotation, Xrot"),
        (span("LeftHand"), r"joint 'LeftHand' has no channels of its own\. Name its parent"),
        (span("Hips", 0, 3), r"frames must lie in the take's 1 to 30\. Got 0 to 3"),
        (span("Hips", 1, 31), r"frames must lie in the take's 1 to 30\. Got 1 to 31"),
    ],
)
def test_what_is_not_there_is_refused(given: Span, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        spanned_channels((given,), skeleton(), 30, 1)


@pytest.mark.parametrize("separator", [",", ";", "\t", " ; "])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("head", ["", "sep={}\n", "\ufeff", "\n\n"])
@pytest.mark.parametrize(
    "header",
    [
        None,
        ("marker", "first", "last"),
        ("Joint", "Start", "End"),
        ("BONE", "from", "TO"),
        ("Name", "First Frame", "last_frame"),
    ],
)
def test_csv_is_read_as_people_export_it(
    tmp_path: Path, separator: str, end: str, head: str, header: tuple[str, ...] | None
) -> None:
    rows = [header] if header else []
    rows += [("LeftArm/*", "11", "13"), ("Hips.Zrotation", "-2", " 4")]
    text = head.format(separator.strip(" ")) + "\n".join(separator.join(row) for row in rows) + "\n\n"
    path = tmp_path / "bad.csv"
    path.write_text(text.replace("\n", end), encoding="utf-8", newline="")
    spans = read_spans(path)
    assert [(one.marker, one.first, one.last) for one in spans] == [("LeftArm/*", 11, 13), ("Hips.Zrotation", -2, 4)]
    line = head.count("\n") + bool(header) + 1
    assert spans[0].place == f"{path}, line {line}"


def test_a_header_gives_the_order_of_the_columns(tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_text("start;end;joint\n3;4;Hips\n")
    (one,) = read_spans(path)
    assert (one.marker, one.first, one.last) == ("Hips", 3, 4)


@pytest.mark.parametrize("text", ["Hips;1\n", "Hips;1;2;3\n", "joint;first;last\nHips;a;2\n", "a;b;c\n", "Hips 1 2\n"])
def test_rows_that_are_no_spans_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(UsageError, match="a span must be marker,first,last"):
        read_spans(path)
