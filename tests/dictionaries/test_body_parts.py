"""Parts of the body by name: real marker sets, and what users write."""

import pytest

from mocapclean import read
from mocapclean.dictionaries.body_parts import PARTS, from_mapping, known_parts
from mocapclean.errors import UsageError

PLUG_IN_GAIT = [
    "LFHD",
    "RFHD",
    "LBHD",
    "RBHD",
    "C7",
    "T10",
    "CLAV",
    "STRN",
    "RBAK",
    "LSHO",
    "LELB",
    "LWRA",
    "LWRB",
    "LFIN",
    "RSHO",
    "RELB",
    "RWRA",
    "RWRB",
    "RFIN",
    "LASI",
    "RASI",
    "LPSI",
    "RPSI",
    "LTHI",
    "LKNE",
    "LTIB",
    "LANK",
    "LHEE",
    "LTOE",
    "RTHI",
    "RKNE",
    "RTIB",
    "RANK",
    "RHEE",
    "RTOE",
]
OWN = {
    "TO": ["a", "b", "c", "d"],
    "LA": ["e"],
    "frame": {"origin": ["a"], "right": ["b"], "left": ["c"], "top": ["d"]},
}


@pytest.mark.parametrize(
    "name",
    [
        "amc/13_17.amc",
        "c3d/MocapRecovery__data_85_12.c3d",
        "c3d/MocapRecovery__data_HDM_mm_01-02_03_120.c3d",
        "bvh/BVH_Viewer__01_01.bvh",
        "bvh/BVH_Viewer__Cartwheel.bvh",
        "bvh/AnimatedDrawings__jesse_dance.bvh",
        "bvh/PyMO__AV_8Walk_Meredith_HVHA_Rep1.bvh",
        "bvh/ammr__S01_T06.bvh",
        "bvh/animation-toolkit__jump.bvh",
    ],
)
def test_real_marker_sets_are_known(captures, name):
    take = read(captures / name)
    parts = known_parts(take.markers)
    assert sorted(parts.markers) == sorted(marker.rpartition(":")[2] for marker in take.markers)
    assert all(parts.parts[part] for part in PARTS)
    assert len(parts.parts["LA"]) == len(parts.parts["RA"])
    assert len(parts.parts["LL"]) == len(parts.parts["RL"])
    assert {marker for group in parts.landmarks for marker in group} <= set(parts.torso)


def test_plug_in_gait_is_known_and_sides_are_told_apart():
    parts = known_parts(PLUG_IN_GAIT)
    assert parts.parts["RL"] == ("RTHI", "RKNE", "RTIB", "RANK", "RHEE", "RTOE")
    assert parts.left == ("LASI", "LPSI")


def test_what_cannot_be_told_is_listed():
    with pytest.raises(UsageError, match="Got Prop1, Sword; assign them"):
        known_parts((*PLUG_IN_GAIT, "Prop1", "Sword"))
    with pytest.raises(UsageError, match="hips and the neck"):
        known_parts(("LKNE", "RKNE"))
    with pytest.raises(UsageError, match="Got C7 twice"):
        known_parts(("Ann:C7", "Bob:C7"))


def test_own_parts_are_read_and_written_alike():
    parts = from_mapping(OWN, "parts.yaml")
    assert parts.markers == ("a", "b", "c", "d", "e")
    assert parts.torso == ("a", "b", "c", "d")
    assert from_mapping(parts.as_mapping(), "again") == parts


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"XX": ["f"]}, "Got XX"),
        ({"LA": "e"}, "must be a list"),
        ({"LA": ["a"]}, "Got a twice"),
        ({"frame": {"origin": ["a"], "right": ["b"], "left": ["c"]}}, "none for top"),
        ({"frame": {"origin": ["z"], "right": ["b"], "left": ["c"], "top": ["d"]}}, "Got z"),
        ({"frame": None}, "must be a mapping"),
        ({"LA": [3]}, "must be a list"),
    ],
)
def test_own_parts_that_make_no_sense_are_refused(change, message):
    with pytest.raises(UsageError, match=message):
        from_mapping({**OWN, **change}, "parts.yaml")
    with pytest.raises(UsageError, match="mapping"):
        from_mapping(["TO"], "parts.yaml")
