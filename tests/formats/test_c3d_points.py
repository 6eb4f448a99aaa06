"""C3D: which points are markers, which are carried along, and what values and residuals are marks of."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from c3d_builder import C3D, DEC, INTEL, Parameter, texts, walk
from c3d_takes import fill, load, rules
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mocapclean import formats
from mocapclean.errors import FormatError, UsageError
from mocapclean.formats import c3d
from mocapclean.formats.c3d.point_kinds import SEGMENTS, is_model_output, is_unlabelled
from mocapclean.pipeline.fill import fill as fill_by
from mocapclean.take import Finding, ReadOptions, Take

MARKERS = ["C7", "CLAV", "LASI", "RASI", "LKNE", "RKNE", "LANK", "RANK"]


def body(n_frames: int = 150, noise: float = 0.2, seed: int = 4) -> np.ndarray:
    """Positions (F, 8, 3) of markers that move by themselves on a walk of a metre, with noise."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0, 6, n_frames)[:, None, None]
    phase = rng.uniform(0, 6, (1, len(MARKERS), 3))
    places = rng.uniform(-400, 400, (1, len(MARKERS), 3)) + np.array([0, 0, 900])
    path = places + [200, 0, 0] * time + 60 * np.sin(2 * time + phase)
    return path + rng.normal(0, noise, path.shape)


def stored(positions: np.ndarray, residual: float = 3.0) -> np.ndarray:
    """Stored numbers (F, P, 4) of positions."""
    return np.concatenate([positions, np.full((*positions.shape[:2], 1), residual)], axis=2)


def file_with(more: np.ndarray, labels: list[str], **facts: object) -> C3D:
    """The body's file with more points (F, n, 3)."""
    return C3D(stored(np.concatenate([body(), more], axis=1)), labels=[*MARKERS, *labels], **facts)  # type: ignore


def finding(take: Take, rule: str) -> Finding:
    (found,) = [f for f in take.findings if f.rule == rule]
    return found


def wandering(n_points: int = 1, seed: int = 9) -> np.ndarray:
    """Positions (F, n, 3) of points that go with nothing."""
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(0, 5, (150, n_points, 3)), axis=0) + 500


def listed(**lists: list[str]) -> dict[str, Parameter]:
    return {name: texts("POINT", name, labels) for name, labels in lists.items()}  # type: ignore[misc]


# Names


@pytest.mark.parametrize(
    "label",
    [
        *("*3", "*1204", "C_7", "uname*21", "uname3", "Unlabeled 1000", "unlabelled_4", "Unlabeled", "Unidentified 12"),
        *("U_0017", "Unnamed 3", "Untitled", "Trajectory 88", "traj_5", "New 0003", "Unknown:6", "Ghost2", "Bob:*8"),
        *("Unassigned-9", "Subject:Unlabeled 3", ""),
    ],
)
def test_names_of_trajectories_without_a_label(tmp_path: Path, label: str) -> None:
    assert is_unlabelled(label)
    content = file_with(wandering(), [label]).build()
    take = load(tmp_path, content)
    assert take.markers == tuple(MARKERS)
    assert "1 without a label" in finding(take, "points").message
    c3d.prove(c3d.write(fill(take, (0, 0)), tmp_path / "out.c3d"), tmp_path / "out.c3d")


@pytest.mark.parametrize(
    "label",
    ["C7", "C_SPINE", "U1", "LUA1", "Trajan", "NEWTOE", "New", "Ghostly", "RTRAJ", "Marker_12", "Point 3", "2003", "*"],
)
def test_names_of_markers_that_look_like_none(tmp_path: Path, label: str) -> None:
    assert not is_unlabelled(label)
    assert label in load(tmp_path, file_with(wandering(), [label])).markers


@pytest.mark.parametrize(
    "label",
    [
        *(
            "CentreOfMass",
            "CenterOfMassFloor",
            "WholeBody_CoM",
            "COM",
            "pelvis_com",
            "CentreOfPressure",
            "COP1",
            "L_COP",
        ),
        *("LHJC", "RKJC2", "LHJCHarrington", "LeftHipCenter", "r_knee_joint_centre", "Virtual 3", "AXISXPelvis"),
        *("ORIGINPelvis", "projLKAX", "LViconLegLength", "RArchHeight", "LeftKneeJoint"),
        *("LKneeAngles", "LKneeAngle", "HipAngles_x", "LGroundReactionForce", "GRF2", "LAnkleMoment", "RHipPower"),
        *("Force_Vector", "LKneeTorque"),
    ],
)
@pytest.mark.parametrize("subject", ["", "Ann:"])
def test_names_of_model_outputs(tmp_path: Path, label: str, subject: str) -> None:
    take = load(tmp_path, file_with(wandering(), [subject + label]))
    assert take.markers == tuple(MARKERS)
    assert subject + label in finding(take, "points").message


@pytest.mark.parametrize(
    "label",
    ["Triangle", "RECTANGLE2", "ForcePlate1", "LKNEO", "STRNL", "LTIB1", "LHDF2", "COMB", "Elbow", "ORIG", "SHOP"],
)
def test_names_of_markers_that_look_like_model_outputs(tmp_path: Path, label: str) -> None:
    assert label in load(tmp_path, file_with(wandering(), [label])).markers


@pytest.mark.parametrize("segment", ["PEL", "LFE", "RTO", "HED", "Box", "LTOES_CGM_2.4"])
def test_the_four_points_of_a_segment(tmp_path: Path, segment: str) -> None:
    labels = [segment + end for end in "OALP"]
    assert load(tmp_path, file_with(wandering(4), labels)).markers == tuple(MARKERS)


def test_two_points_of_a_segment_are_enough_where_it_is_known() -> None:
    assert is_model_output("RFEP", {"RFEP", "RFEO"})
    assert not is_model_output("RFEP", {"RFEP"})
    assert not is_model_output("BOXP", {"BOXP", "BOXO", "BOXA"})
    assert SEGMENTS.fullmatch("PEL")


def test_the_foot_model_is_known_by_its_origins(tmp_path: Path) -> None:
    labels = ["LHDF0", "LHDF1", "LTIB1", "LTIB2", "LD1M0", "PEL0", "LPROXFF"]
    assert load(tmp_path, file_with(wandering(7), labels)).markers == tuple(MARKERS)
    assert "LTIB1" in load(tmp_path, file_with(wandering(6), [*labels[2:-1], "LTOE"])).markers


def test_names_of_a_kind_are_counted_and_some_are_shown(tmp_path: Path) -> None:
    labels = [f"*{k}" for k in range(7)] + ["LHJC", "Spin", "LASI_proj"]
    take = load(tmp_path, file_with(wandering(10), labels, extra=listed(SCALARS=["Spin"])))
    message = finding(take, "points").message
    assert message.startswith("9 of 18 points are carried along untouched: 7 without a label (*0, *1, *2, *3, *4 and 2")
    assert "1 listed as angles, forces or the like (Spin)" in message
    assert take.markers[-1] == "LASI_proj"
    assert formats.carried(take) == (*labels[:7], "LHJC", "Spin")


# Positions


def test_a_point_at_a_constant_distance_is_computed(tmp_path: Path) -> None:
    positions = body()
    axis = positions[:, 5] - positions[:, 4]
    beside = positions[:, 4] + 45 * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    copy = positions[:, 2]
    take = load(tmp_path, file_with(np.stack([beside, copy], axis=1), ["inside", "twin"]))
    assert take.markers == tuple(MARKERS)
    assert "2 exact functions of other points (inside, twin)" in finding(take, "points").message


def test_copies_are_computed_even_if_they_are_the_most(tmp_path: Path) -> None:
    copies = np.concatenate([body(), body()], axis=1)
    take = load(tmp_path, file_with(copies, [*MARKERS, *MARKERS]))
    assert take.markers == tuple(MARKERS)


def test_it_stays_computed_where_the_marker_was_repaired(tmp_path: Path) -> None:
    beside = body()[:, 4] + [0, 30, 0]
    file = file_with(beside[:, None], ["inside"])
    file.points[40:50, 4, :3] += 25
    assert "inside" not in load(tmp_path, file).markers


def test_a_point_on_the_floor_is_computed(tmp_path: Path) -> None:
    floor = body()[:, [3]] * [1, 1, 0] + [5, 5, 0]
    assert load(tmp_path, file_with(floor, ["pressure"])).markers == tuple(MARKERS)


@pytest.mark.parametrize("noise", [0.1, 0.5])
def test_rigid_markers_with_noise_are_markers(tmp_path: Path, noise: float) -> None:
    rng = np.random.default_rng(1)
    beside = body(noise=0)[:, [4, 4, 4]] + [[0, 30, 0], [40, 0, 0], [0, 0, 60]] + rng.normal(0, noise, (150, 3, 3))
    assert len(load(tmp_path, file_with(beside, ["box1", "box2", "box3"])).markers) == 11


def test_what_rests_without_any_noise_is_a_marker(tmp_path: Path) -> None:
    floor = np.broadcast_to([[300.0, 20.0, 10.0], [900.0, 20.0, 10.0]], (150, 2, 3))
    assert len(load(tmp_path, file_with(floor, ["floor1", "floor2"])).markers) == 10


def test_in_a_take_of_a_skeleton_all_distances_are_constant(tmp_path: Path) -> None:
    chain = body(noise=0)[:, [0]] + np.arange(8)[:, None] * [0.0, 50.0, 0.0]
    assert len(load(tmp_path, C3D(stored(chain))).markers) == 8


def test_in_a_take_of_two_dimensions_one_coordinate_is_constant(tmp_path: Path) -> None:
    assert len(load(tmp_path, C3D(stored(body() * [1, 1, 0] + [1, 1, 0]))).markers) == 8


def test_a_point_that_is_never_seen_is_carried(tmp_path: Path) -> None:
    file = file_with(wandering(), ["LTOE"])
    file.points[:, -1] = [0, 0, 0, -1]
    take = load(tmp_path, file)
    assert take.markers == tuple(MARKERS)
    assert "1 never seen (LTOE)" in finding(take, "points").message
    assert load(tmp_path, file, points=("LTOE",)).markers == (*MARKERS, "LTOE")


def test_where_nothing_is_seen_all_markers_stay(tmp_path: Path) -> None:
    points = np.zeros((20, 5, 4))
    points[..., 3] = -1
    assert len(load(tmp_path, C3D(points)).markers) == 5


# What the user names


@pytest.mark.parametrize(
    ("label", "is_alone"),
    [("LKneeAngles", True), ("Lean", True), ("*4", True), ("LHJC", False), ("twin", False)],
)
def test_a_named_point_is_read_and_what_is_no_place_moves_alone(tmp_path: Path, label: str, is_alone: bool) -> None:
    extra = body()[:, [2]] if label == "twin" else wandering()
    take = load(tmp_path, file_with(extra, [label], extra=listed(POWERS=["Lean"])), points=(label,))
    assert take.markers == (*MARKERS, label)
    assert take.detached.tolist() == [*[False] * 8, is_alone]
    assert "points" not in rules(take)


@pytest.mark.parametrize(("wanted", "near"), [("lkne", "LKNE"), ("c7", "C7"), ("ann:RKnE", "Ann:rkne")])
def test_a_name_that_differs_in_case_is_suggested_first(tmp_path: Path, wanted: str, near: str) -> None:
    with pytest.raises(UsageError, match=rf"Got '{wanted}'\. Near it: {near}"):
        load(tmp_path, file_with(wandering(), ["Ann:rkne"]), points=(wanted,))


@pytest.mark.parametrize("name", ["*{}", "uname*{}", "Unlabeled {}"])
def test_in_a_take_without_labels_each_point_moves_alone(tmp_path: Path, name: str) -> None:
    take = load(tmp_path, C3D(stored(body()), labels=[name.format(k) for k in range(8)]))
    assert len(take.markers) == 8
    assert take.detached.all()
    assert finding(take, "unlabelled").message.startswith("none of the 8 points has a label")


def test_only_model_outputs_are_markers_for_lack_of_others(tmp_path: Path) -> None:
    labels = ["LHJC", "LKJC", "RHJC", "*1", "RKJC", "LAJC", "RAJC", "COM"]
    assert load(tmp_path, C3D(stored(body()), labels=labels)).markers == ("*1",)
    assert len(load(tmp_path, C3D(stored(body()), labels=[*labels[:3], "LSJC", *labels[4:]])).markers) == 8


def test_only_quantities_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="must have markers"):
        load(tmp_path, C3D(walk(n_points=2), labels=["LKneeAngles", "GRF"]))


# What a repair leaves out of date


def model_file() -> C3D:
    positions = body()
    inside = positions[:, 4] + 3 * np.sin(np.arange(150) / 9)[:, None]
    far = positions[:, 1] + [0, 0, 80]
    angles = wandering(3)
    extra = np.concatenate([np.stack([inside, far], axis=1), angles], axis=1)
    labels = ["LKJC", "NeckJC", "LKneeAngles", "RKneeAngles", "SpineAngles"]
    return file_with(extra, labels)


def test_points_that_follow_a_repaired_marker_are_out_of_date(tmp_path: Path) -> None:
    take = load(tmp_path, model_file())
    assert formats.outdated(take) == ()
    assert formats.outdated(fill(take, (30, 4), (31, 4))) == ("LKJC", "LKneeAngles", "SpineAngles")
    assert formats.outdated(fill(take, (30, 1))) == ("NeckJC", "LKneeAngles", "RKneeAngles", "SpineAngles")
    assert formats.outdated(fill(take, (30, 5))) == ("RKneeAngles", "SpineAngles")
    assert formats.outdated(fill(take, (30, 5)).select(np.arange(8))) == ()


# Far marks, numbers that are none, residuals


@pytest.mark.parametrize(
    "mark",
    [(9999999,) * 3, (1e6, 1e6, 1e6), (-1e5, -1e5, -1e5), (99999.0,) * 3, (9999999, 0, 0), (5e5, 20.0, -3e5)],
    ids=str,
)
@pytest.mark.parametrize("machine", [INTEL, DEC])
def test_a_far_number_that_repeats_is_missing(tmp_path: Path, mark: tuple[float, ...], machine: int) -> None:
    points = stored(body())
    points[20:33, 2, :3] = mark
    points[70:80, 5, :3] = mark
    take = load(tmp_path, C3D(points, machine))
    expected = np.zeros((150, 8), dtype=bool)
    expected[20:33, 2] = expected[70:80, 5] = True
    np.testing.assert_array_equal(~take.trusted, expected)
    assert finding(take, "marks").message.startswith("23 samples of 2 markers hold ")


def test_two_marks_in_one_take(tmp_path: Path) -> None:
    points = stored(body())
    points[20:60, 2, :3], points[20:60, 3, :3] = 1e6, 9999999
    assert (~load(tmp_path, C3D(points)).trusted).sum() == 80


@pytest.mark.parametrize(
    ("frames", "value"),
    [
        (slice(20, 23), (1e6, 1e6, 1e6)),
        (slice(20, 60), (9000.0, 20.0, 900.0)),
        (slice(0, 150), (30_000.0, -2000.0, 10.0)),
        (slice(20, 60), (3000.0, 3000.0, 3000.0)),
    ],
    ids=["few", "not so far", "a thing at rest", "equal and near"],
)
def test_what_is_far_or_repeats_alone_is_no_mark(tmp_path: Path, frames: slice, value: tuple[float, ...]) -> None:
    points = stored(body())
    points[frames, 2, :3] = value
    assert load(tmp_path, C3D(points)).trusted.all()


@given(seed=st.integers(0, 999), scale=st.sampled_from([0.01, 1.0, 100.0]), still=st.integers(0, 8))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_moving_or_resting_marker_is_hit(tmp_path: Path, seed: int, scale: float, still: int) -> None:
    positions = scale * body(seed=seed)
    positions[:, :still] = positions[0, :still]
    take = load(tmp_path, C3D(stored(positions)))
    assert take.trusted.all()


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan, 3e38])
def test_numbers_that_are_none_warn_nowhere(tmp_path: Path, value: float) -> None:
    points = stored(body())
    points[20:40, 2, :3] = value
    points[60, 3, 1] = value
    points[80, 1, 3] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        take = load(tmp_path, C3D(points))
        filled = fill_by(take, "linear").take
    assert np.isfinite(take.positions).all()
    assert filled.filled[20:40, 2].all()


def test_residuals_that_deny_what_is_there(tmp_path: Path) -> None:
    take = load(tmp_path, C3D(stored(body(), residual=-1)))
    told = finding(take, "residuals")
    assert told.level == "warning"
    assert "1200 of 1200 samples have coordinates" in told.message
    assert len(take.markers) == 8


def test_samples_that_another_program_filled(tmp_path: Path) -> None:
    points = stored(body(), residual=770)
    points[10:14, 2, 3] = points[90, 6, 3] = 0
    points[:, 7, 3] = 0
    told = finding(load(tmp_path, C3D(points)), "interpolated")
    assert told.level == "info"
    assert told.message.startswith("5 samples of 2 markers have residual 0")
    assert "interpolated" not in rules(load(tmp_path, C3D(stored(body(), residual=0))))


def test_no_message_ends_with_a_period_and_no_advice_begins_with_a_capital(tmp_path: Path) -> None:
    """A report joins them: message; advice."""
    points = stored(body())
    points[..., 3] = -1
    files = [
        C3D(points, units="furlong", labels=["A", "A", *"BCDEFG"]),
        C3D(stored(body()), labels=[f"*{k}" for k in range(8)], rate=50, units=None),
        file_with(wandering(), ["LHJC"], is_float=False, tail=bytes(5000)),
        file_with(wandering(), ["LHJC"], last_frame=40),
    ]
    findings = [f for file in files for f in load(tmp_path, file).findings]
    assert {"residuals", "units", "labels", "unlabelled", "points", "layout"} <= {f.rule for f in findings}
    for told in findings:
        assert not told.message.endswith("."), told
        assert not told.advice.endswith("."), told
        assert told.advice[:1] == told.advice[:1].lower(), told


# Units


@pytest.mark.parametrize(
    ("stated", "given_unit", "factor", "is_told"),
    [
        ("mm", 1000.0, 1000, True),
        ("m", 10.0, 10, True),
        ("furlong", 5.0, 5, True),
        ("cm", 10.0, 10, False),
        ("   ", 1000.0, 1000, False),
        (None, 25.4, 25.4, False),
    ],
)
def test_a_given_unit_comes_first(tmp_path, stated: str | None, given_unit: float, factor: float, is_told) -> None:
    take = load(tmp_path, C3D(stored(body()), units=stated), unit=given_unit)
    np.testing.assert_allclose(take.positions, factor * body(), rtol=1e-6)
    assert ("units" in rules(take)) == is_told
    assert not any("millimetres" in told.message for told in take.findings)


def test_a_fill_is_stored_in_the_given_unit(tmp_path: Path) -> None:
    take = load(tmp_path, C3D(stored(body()), units="mm"), unit=25.4)
    written = c3d.write(fill(take, (3, 2), position=(25.4, 50.8, 254.0)), tmp_path / "out.c3d")
    c3d.prove(written, tmp_path / "out.c3d")
    again = c3d.read(tmp_path / "out.c3d", ReadOptions())
    np.testing.assert_allclose(again.positions[3, 2], (1, 2, 10), rtol=1e-6)
