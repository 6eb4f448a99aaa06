"""The unit of length of skeletons that state none: bodies of any unit, and what is no body."""

from pathlib import Path

import numpy as np
import pytest
from conftest import capture_files
from hypothesis import given, settings
from hypothesis import strategies as st

from mocapclean.formats import bvh
from mocapclean.formats.units import UNITS, BodyScale, body_scale
from mocapclean.take import ReadOptions

# Joint, parent, offset in millimetres of a body of 1.7 m.
TRUNK = [
    ("Hips", "", (0, 0, 0)),
    ("Spine", "Hips", (0, 100, 0)),
    ("Chest", "Spine", (0, 200, 0)),
    ("Neck", "Chest", (0, 230, 0)),
    ("Head", "Neck", (0, 100, 0)),
]
SIDE = [
    ("Collar", "Chest", (30, 180, 0)),
    ("Arm", "Collar", (150, 0, 0)),
    ("ForeArm", "Arm", (280, 0, 0)),
    ("Hand", "ForeArm", (260, 0, 0)),
    ("UpLeg", "Hips", (90, -40, 0)),
    ("Leg", "UpLeg", (0, -420, 0)),
    ("Foot", "Leg", (0, -400, 0)),
    ("Toe", "Foot", (0, -60, 130)),
]
OTHER = {
    **{"Hips": "pelvis", "Spine": "abdomen", "Chest": "thorax", "Neck": "cervical", "Head": "skull", "Collar": "clav"},
    **{"Arm": "shoulder", "ForeArm": "elbow", "Hand": "wrist", "UpLeg": "hip", "Leg": "knee", "Foot": "ankle"},
}
STATURE = 1700.0
NAMINGS = {
    "plain": str,
    "mixamo": lambda name: f"mixamorig:{name}",
    "other": lambda name: OTHER.get(name.lstrip("LR"), name) if name[:1] in "LR" else OTHER.get(name, name),
    "none": lambda name: "",
}
FORMS = "HIERARCHY\n{tree}MOTION\nFrames: 1\nFrame Time: 0.01\n{row}\n"


def body() -> list[tuple[str, str, np.ndarray]]:
    sides = [(f"{side}{name}", side, parent, offset) for side in "LR" for name, parent, offset in SIDE]
    common = {name for name, _, _ in TRUNK}
    return [(name, parent, np.array(offset, dtype=float)) for name, parent, offset in TRUNK] + [
        (name, parent if parent in common else side + parent, np.array(offset) * [1.0 if side == "L" else -1.0, 1, 1])
        for name, side, parent, offset in sides
    ]


def scale_of(joints: list[tuple[str, str, np.ndarray]], size: float, naming: str = "plain") -> BodyScale:
    """Return the scale of joints whose offsets are divided by ``size``, under a convention of names."""
    places = {name: index for index, (name, _, _) in enumerate(joints)}
    names = [NAMINGS[naming](name) or f"joint{index}" for index, (name, _, _) in enumerate(joints)]
    parents = [places.get(parent, -1) for _, parent, _ in joints]
    return body_scale(names, parents, np.array([offset for _, _, offset in joints]) / size, 10.0)


def text(joints: list[tuple[str, str, np.ndarray]], size: float, *, six: bool, zero: bool) -> str:
    """Return a BVH with its joints in depth-first order and, if asked for, position channels that have the offsets."""
    rows: list[str] = []

    def braces(name: str) -> str:
        offset = next(o for n, _, o in joints if n == name) / size
        spelled = " ".join(f"{value:.6f}" for value in offset)
        below = "".join(braces(n) for n, parent, _ in joints if parent == name)
        is_root = name == "Hips"
        count = "6 Xposition Yposition Zposition" if six or is_root else "3"
        rows.append("")
        return (
            f"{'ROOT' if is_root else 'JOINT'} {name}\n{{\nOFFSET {'0 0 0' if zero else spelled}\n"
            f"CHANNELS {count} Zrotation Xrotation Yrotation\n{below}}}\n"
        )

    tree = braces("Hips")
    order = [line.split()[1] for line in tree.splitlines() if line.startswith(("ROOT", "JOINT"))]
    offsets = {name: offset / size for name, _, offset in joints}
    row = " ".join(
        (" ".join(f"{v:.6f}" for v in offsets[name]) + " " if six or name == "Hips" else "") + "0 0 0" for name in order
    )
    return FORMS.format(tree=tree, row=row)


@settings(max_examples=200, deadline=None, database=None)
@given(st.sampled_from(["cm", "m", "in", "CMU's unit", "mm"]), st.floats(1450, 1950), st.sampled_from(sorted(NAMINGS)))
def test_the_unit_of_a_body_is_found(unit: str, stature: float, naming: str) -> None:
    found = scale_of(body(), UNITS[unit][0] * STATURE / stature, naming)
    assert found.is_known
    assert found.millimetres == UNITS[unit][0]
    assert found.stature == pytest.approx(stature, rel=0.15)
    assert f"({unit})" in found.reason


@settings(max_examples=100, deadline=None, database=None)
@given(st.randoms(use_true_random=False), st.sampled_from(["cm", "m", "in", "mm"]))
def test_the_order_of_joints_does_not_matter(random, unit: str) -> None:
    left, joints = body(), []
    while left:  # any order in which a joint comes after its parent
        ready = [joint for joint in left if not joint[1] or joint[1] in {name for name, _, _ in joints}]
        joints.append(random.choice(ready))
        left = [joint for joint in left if joint[0] != joints[-1][0]]
    found, wanted = scale_of(joints, UNITS[unit][0]), scale_of(body(), UNITS[unit][0])
    assert found.millimetres == wanted.millimetres == UNITS[unit][0]
    assert found.stature == pytest.approx(wanted.stature)


@pytest.mark.parametrize("unit", ["cm", "m", "in", "mm"])
@pytest.mark.parametrize("lacking", ["Head", "Neck|Head", "Toe", "Collar|Arm|ForeArm|Hand", "UpLeg|Leg|Foot|Toe"])
def test_a_body_that_lacks_parts_is_one(lacking: str, unit: str) -> None:
    joints = [
        joint for joint in body() if joint[0] not in lacking.split("|") and joint[0][1:] not in lacking.split("|")
    ]
    assert len(joints) < len(body())
    assert scale_of(joints, UNITS[unit][0]).millimetres == UNITS[unit][0]


def test_four_legs_and_a_head_are_no_human_body() -> None:
    legs = {"Collar": "FrontUpLeg", "Arm": "FrontLeg", "ForeArm": "FrontFoot", "Hand": "FrontToe"}

    def renamed(name: str) -> str:
        return name[:1] + legs[name[1:]] if name[1:] in legs else name

    horse = [(renamed(name), renamed(parent), offset) for name, parent, offset in body()]
    assert not scale_of(horse, 10.0).is_known


def test_a_prop_beside_a_body_changes_nothing() -> None:
    prop = [("Table", "", np.zeros(3)), ("Plate", "Table", np.array([0.0, 9000.0, 0.0]))]
    assert scale_of([*prop, *body()], 10.0) == scale_of(body(), 10.0)


@pytest.mark.parametrize("size", [10.0, 1.0, 56.444, 25.4, 1000.0])
def test_what_is_no_body_has_no_known_scale(size: float) -> None:
    hand = [("LHand", "", np.zeros(3))]
    for finger in ("Thumb", "Index", "Middle", "Ring", "Pinky"):
        hand.append((f"{finger}1", "LHand", np.array([90.0, 5.0, 0.0])))
        hand += [(f"{finger}{n}", f"{finger}{n - 1}", np.array([30.0, 0.0, 0.0])) for n in (2, 3)]
    dog = [*body(), ("Tail", "Hips", np.array([0.0, 0.0, -300.0]))]
    prop = [("Sword", "", np.zeros(3)), ("Tip", "Sword", np.array([0.0, 900.0, 0.0]))]
    point = [(name, parent, np.zeros(3)) for name, parent, _ in body()]
    for joints in (hand, dog, prop, point):
        found = scale_of(joints, size)
        assert not found.is_known
        assert found.millimetres == 10.0
        assert found.stature is None
        assert "scale is unknown" in found.reason


def test_a_body_of_no_human_size_has_no_known_scale() -> None:
    found = scale_of(body(), STATURE / 450.0)  # 450 units: 45 cm as millimetres, 4.5 m as centimetres
    assert not found.is_known
    assert "no usual unit" in found.reason


def test_two_units_are_named_where_both_are_human() -> None:
    found = scale_of(body(), STATURE / 17.0)  # 17 units: 1.7 m in decimetres, or a child of 0.96 m in CMU's unit
    assert found.is_known
    assert found.millimetres == 100.0
    assert found.reason.endswith("likelier than 0.96 m (CMU's unit)")


def test_a_small_child_is_no_giant() -> None:
    assert scale_of(body(), STATURE / 90.0).millimetres == 10.0  # 0.9 m in centimetres, not 2.3 m in inches


@pytest.mark.parametrize(("six", "zero"), [(False, False), (True, False), (True, True)])
@pytest.mark.parametrize("unit", [1.0, 10.0, 25.4, 1000.0])
def test_a_file_is_read_in_its_unit(tmp_path: Path, unit: float, *, six: bool, zero: bool) -> None:
    path = tmp_path / "take.bvh"
    path.write_text(text(body(), unit, six=six, zero=zero))
    take = bvh.read(path, ReadOptions())
    document = take.origin.document
    assert document.unit.is_known
    assert take.skeleton.is_scaled
    assert document.unit.millimetres == unit
    head, foot = (take.markers.index(name) for name in ("Head", "LFoot"))
    assert take.positions[0, head, 1] - take.positions[0, foot, 1] == pytest.approx(630 + 860, abs=0.01)
    (finding,) = take.findings
    assert (finding.rule, finding.level) == ("units", "info")
    assert f"taken as {unit:g} mm: the body is then about " in finding.message
    if not zero:
        np.testing.assert_allclose(bvh.read_skeleton(path).before, take.skeleton.before)
    given = bvh.read(path, ReadOptions(unit=3.0))
    assert given.origin.document.unit == BodyScale(millimetres=3.0, is_known=True, reason="as given")
    np.testing.assert_allclose(given.positions, take.positions * 3.0 / unit)


def test_a_file_without_a_body_is_read_in_centimetres_of_no_known_scale(tmp_path: Path) -> None:
    path = tmp_path / "take.bvh"
    path.write_text(
        text([("Hips", "", np.zeros(3)), ("Tip", "Hips", np.array([0.0, 30.0, 0.0]))], 1.0, six=False, zero=False)
    )
    take = bvh.read(path, ReadOptions())
    assert not take.skeleton.is_scaled
    assert not take.select(np.array([1])).skeleton.is_scaled
    assert not bvh.read_skeleton(path).is_scaled
    assert take.positions[0, 1, 1] == pytest.approx(300.0)
    (finding,) = take.findings
    assert (finding.level, finding.advice) == ("info", "give the unit (--unit) if lengths look wrong")
    assert "its scale is unknown" in finding.message
    assert bvh.read(path, ReadOptions(unit=1.0)).skeleton.is_scaled


@pytest.mark.parametrize(
    ("name", "is_animal"),
    [
        ("BN_Tail_01", True), ("LeftWings", True), ("Tail1", True), ("HindLeg", True), ("R_Paw", True),
        ("PonyTail", False), ("hair_tail_2", False), ("Cocktail", False), ("Detail", False), ("LeftHand", False),
    ],
)  # fmt: skip
def test_parts_of_animals_make_no_human_body(name: str, is_animal: bool) -> None:
    assert scale_of([*body(), (name, "Hips", np.ones(3))], 10.0).is_known != is_animal


@pytest.mark.parametrize("path", capture_files("bvh"), ids=lambda path: path.name)
def test_captures_have_human_sizes_or_none(path: Path) -> None:
    found = bvh.read(path, ReadOptions()).origin.document.unit
    assert found.is_known == (found.stature is not None)
    assert bvh.read_skeleton(path).is_scaled == found.is_known
    if found.stature is not None:
        assert 1100 < found.stature < 2000
