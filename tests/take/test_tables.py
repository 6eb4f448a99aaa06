"""Takes as xarray Datasets and pandas tables, and back."""

import sys

import numpy as np
import pytest

import mocapclean
from mocapclean.errors import UsageError
from mocapclean.take.status import Status
from tests.conftest import SAMPLES

xarray = pytest.importorskip("xarray", reason="the extra xarray is not installed")


@pytest.fixture(scope="module")
def result():
    return mocapclean.fill(mocapclean.detect(mocapclean.read(SAMPLES / "walk.c3d")), self_check=False, max_gap=60)


def test_a_dataset_has_the_layout_of_poses(result):
    dataset = result.to_xarray()
    assert dataset["position"].dims == ("time", "space", "keypoint", "individual")
    for name in ("confidence", "status", "sd"):
        assert dataset[name].dims == ("time", "keypoint", "individual")
    assert dataset["keypoint"].to_numpy().tolist() == list(result.take.markers)
    assert dataset["space"].to_numpy().tolist() == ["x", "y", "z"]
    assert dataset["frame"].to_numpy()[[0, -1]].tolist() == [1, 480]
    assert {"ds_type": "poses", "fps": 120.0, "time_unit": "seconds"}.items() <= dataset.attrs.items()
    assert dataset["time"].to_numpy()[12] == pytest.approx(0.1)
    lank = dataset["position"].sel(keypoint="LANK", individual="individual_0").to_numpy()
    assert np.array_equal(lank, result.take["LANK"], equal_nan=True)
    assert dataset["status"].attrs["flag_meanings"].split() == [status.code for status in Status]


def test_status_error_bars_and_confidence_are_those_of_the_result(result):
    dataset, take = result.to_xarray().isel(individual=0), result.take
    assert np.array_equal(dataset["status"], result.status)
    assert np.array_equal(dataset["sd"].to_numpy()[take.filled], result.sd[take.filled])
    assert np.isnan(dataset["sd"].to_numpy()[~take.filled]).all()
    confidence = dataset["confidence"].to_numpy()
    assert (confidence[take.trusted] == 1.0).all()
    left = ~take.trusted & ~take.filled
    assert left.any()
    assert (confidence[left] == 0.0).all()
    assert ((confidence[take.filled] > 0.5) & (confidence[take.filled] <= 1.0)).all()


def test_confidence_is_the_share_of_errors_within_ten_millimetres(result, rng):
    from mocapclean.take.tables import to_xarray

    for sd in (2.0, 5.0, 9.0, 40.0):
        dataset = to_xarray(result.take, result.status, np.full(result.status.shape, sd))
        drawn = np.linalg.norm(rng.normal(0.0, sd, (40_000, 3)), axis=1) <= 10.0
        stated = dataset["confidence"].isel(individual=0).to_numpy()[result.take.filled]
        np.testing.assert_allclose(stated, drawn.mean(), atol=0.01)


def test_a_filled_sample_without_an_error_bar_has_no_confidence():
    take = mocapclean.fill(mocapclean.read(SAMPLES / "walk.c3d"), "linear", self_check=False).take
    assert np.isnan(take.to_xarray()["confidence"].isel(individual=0).to_numpy()[take.filled]).all()


@pytest.mark.parametrize("file", ["walk.c3d", "walk.bvh"])
def test_a_dataset_becomes_the_same_take(file):
    take = mocapclean.fill(mocapclean.read(SAMPLES / file), "linear", self_check=False).take
    dataset = take.to_xarray()
    back = mocapclean.from_xarray(dataset)
    assert np.array_equal(back.to_numpy(), take.to_numpy(), equal_nan=True)
    measured = take.trusted if take.poses is None else take.as_markers().trusted
    assert np.array_equal(back.trusted, measured)
    assert np.array_equal(back.filled, take.placed & ~measured)
    assert (back.markers, back.rate, back.first_frame) == (take.markers, take.rate, take.first_frame)
    assert np.array_equal(back.to_xarray()["position"], dataset["position"], equal_nan=True)
    assert mocapclean.Take.from_xarray(dataset) == back


def test_a_dataset_of_a_joint_take_has_the_positions_of_its_joints():
    take = mocapclean.fill(mocapclean.read(SAMPLES / "walk.bvh"), max_gap=60, self_check=False).take
    dataset = take.to_xarray().isel(individual=0)
    known = take.placed
    status, confidence = dataset["status"].to_numpy(), dataset["confidence"].to_numpy()
    assert np.array_equal(confidence == 1.0, take.as_markers().trusted)
    assert np.array_equal(confidence == 0.0, ~known)
    assert 0 < (np.isin(status, (Status.FILLED, Status.REPLACED))).sum() == np.isnan(confidence).sum()
    places = dataset["position"].transpose("time", "keypoint", "space").to_numpy()
    assert np.array_equal(places[known], take.positions[known])
    assert np.isnan(places[~known]).all()


def tracks(**changes):
    """A Dataset as a tracker makes it: two individuals with two keypoints, one sample missing."""
    position = np.arange(5 * 3 * 2 * 2, dtype=np.float32).reshape(5, 3, 2, 2)
    position[2, :, 1, 0] = np.nan
    layout = {"dims": ("time", "space", "keypoint", "individual"), "fps": 50.0, **changes}
    coords = dict(zip(layout["dims"], (np.arange(5) / 50, ["x", "y", "z"], ["nose", "tail"], ["a", "b"]), strict=True))
    attrs = {"ds_type": "poses", **({"fps": layout["fps"]} if layout["fps"] else {}), "time_unit": "seconds"}
    return xarray.Dataset({"position": (layout["dims"], position)}, coords=coords, attrs=attrs)


@pytest.mark.parametrize(
    "dims", [("time", "space", "keypoint", "individual"), ("time", "space", "keypoints", "individuals")]
)
@pytest.mark.parametrize("fps", [50.0, None])
def test_tracks_of_others_become_a_take_that_can_be_filled(dims, fps):
    take = mocapclean.from_xarray(tracks(dims=dims, fps=fps))
    assert take.markers == ("a:nose", "a:tail", "b:nose", "b:tail")
    assert take.rate == pytest.approx(50.0)
    assert np.argwhere(~take.trusted).tolist() == [[2, 1]]
    assert np.isfinite(mocapclean.fill(take, "linear", self_check=False).take["a:tail"]).all()


def test_what_is_no_dataset_of_poses_is_refused():
    with pytest.raises(UsageError, match="must have the variable position"):
        mocapclean.from_xarray(xarray.Dataset())
    with pytest.raises(UsageError, match="must have the dimensions"):
        mocapclean.from_xarray(tracks().isel(space=[0, 1]))
    with pytest.raises(UsageError, match="frames per second"):
        mocapclean.from_xarray(tracks(fps=None).isel(time=[0]))


def test_a_table_has_a_row_for_each_frame_and_three_columns_for_each_marker(result):
    table = result.take.to_dataframe()
    assert table.shape == (480, 3 * 41)
    assert table.columns.names == ["marker", "axis"]
    assert table.index.name == "time"
    assert np.array_equal(table["LANK"].to_numpy(), result.take["LANK"], equal_nan=True)
    assert table.isna().to_numpy().any()


@pytest.mark.parametrize(("call", "library"), [("to_xarray", "xarray"), ("to_dataframe", "pandas")])
def test_without_the_extra_the_sentence_says_what_to_install(monkeypatch, result, call, library):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(UsageError, match=r"\.\[xarray\]"):
        getattr(result.take, call)()


def test_the_names_of_the_space_say_which_axis_is_which(result):
    dataset = result.to_xarray()
    turned = mocapclean.from_xarray(dataset.sel(space=["z", "x", "y"]))
    assert turned == mocapclean.from_xarray(dataset)
    unnamed = mocapclean.from_xarray(dataset.drop_vars("space"))
    assert np.array_equal(unnamed.positions, turned.positions)
    with pytest.raises(UsageError, match=r"must be x, y and z\. Got u, v, w"):
        mocapclean.from_xarray(dataset.assign_coords(space=["u", "v", "w"]))


def test_times_must_rise_and_uneven_ones_are_told(result):
    dataset = result.to_xarray()
    with pytest.raises(UsageError, match="must rise"):
        mocapclean.from_xarray(dataset.isel(time=slice(None, None, -1)))
    (finding,) = mocapclean.from_xarray(dataset.isel(time=[0, 1, 2, 5])).findings
    assert (finding.rule, finding.level) == ("times", "warning")
    assert mocapclean.from_xarray(dataset).findings == ()


def test_a_variable_alone_is_no_dataset(result):
    with pytest.raises(UsageError, match=r"takes a Dataset\. Got DataArray"):
        mocapclean.from_xarray(result.to_xarray()["position"])


@pytest.mark.parametrize("fps", [-5, float("nan"), "fast"])
def test_frames_per_second_must_be_positive(result, fps):
    with pytest.raises(UsageError, match="fps of a Dataset must be a positive number"):
        mocapclean.from_xarray(result.to_xarray().assign_attrs(fps=fps))
