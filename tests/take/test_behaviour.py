"""A take in Python: what it shows, what an index gives, when two are equal."""

import dataclasses

import numpy as np
import pytest

import mocapclean
from mocapclean.errors import UsageError
from mocapclean.take import Take
from tests.conftest import SAMPLES


@pytest.fixture(scope="module")
def walk():
    return mocapclean.read(SAMPLES / "walk.c3d")


@pytest.fixture(scope="module")
def joints():
    return mocapclean.read(SAMPLES / "walk.bvh")


def test_a_take_shows_its_size_and_no_numbers(walk, joints):
    assert repr(walk) == "<Take walk.c3d: 480 frames, 41 markers, 120 Hz, 1,000 samples missing>"
    assert "joints" in repr(joints)
    assert len(walk) == len(walk.positions) == 480
    filled = mocapclean.fill(walk, "linear", self_check=False).take
    assert repr(filled).endswith("209 samples missing, 791 filled>")


def test_an_index_gives_paths_with_nan_where_a_sample_is_missing(walk):
    column = walk.markers.index("LANK")
    path = walk["LANK"]
    assert path.shape == (480, 3)
    known = walk.trusted[:, column]
    assert not known.all()
    assert np.isnan(path[~known]).all()
    assert np.array_equal(path[known], walk.positions[known, column])
    assert np.array_equal(
        walk[["LANK", "STRN"]], walk.to_numpy()[:, [column, walk.markers.index("STRN")]], equal_nan=True
    )
    path[:] = 0.0  # a copy: the take stays as it is
    assert np.isfinite(walk["LANK"][known]).all()
    assert walk["LANK"][known].any()


def test_a_filled_sample_is_in_the_path(walk):
    filled = mocapclean.fill(walk, "linear", self_check=False).take
    assert np.array_equal(np.isfinite(filled.to_numpy()).all(axis=2), filled.trusted | filled.filled)


@pytest.mark.parametrize("wrong", ["LANKLE", 3, slice(3), ("LANK",), ["LANK", 3], None])
def test_what_is_no_marker_is_refused_in_one_sentence(walk, wrong):
    with pytest.raises(UsageError, match=r"take"):
        walk[wrong]


def test_names_are_in_a_take_and_nothing_is_iterated(walk):
    assert "LANK" in walk
    assert "LANKLE" not in walk
    with pytest.raises(TypeError, match="not iterable"):
        iter(walk)


def test_a_joint_below_an_unknown_one_has_no_position(joints):
    known = joints.known.copy()
    hips = [k for k, channel in enumerate(joints.skeleton.channels) if channel.joint == 0]
    known[10:20, hips] = False
    damaged = joints.with_known(known)
    assert not damaged.placed[10:20].any()
    filled = mocapclean.fill(damaged, self_check=False).take
    assert filled.filled[10:20, 0].all()
    assert np.array_equal(filled.placed[10:20], mocapclean.fill(joints, self_check=False).take.placed[10:20])


def changed(value):
    """The value of a field with another content, or None where there is no simple one."""
    if isinstance(value, np.ndarray) and value.size:
        other = value.copy()
        other.flat[0] = not other.flat[0] if other.dtype == bool else other.flat[0] + 1.0
        return other
    return {str: "x", float: 1.5, int: 7}.get(type(value))


@pytest.mark.parametrize("file", ["walk.c3d", "walk.bvh"])
def test_takes_are_equal_by_content(file):
    one, same = (mocapclean.read(SAMPLES / file) for _ in range(2))
    assert one == same
    assert dataclasses.replace(one, origin=None) == same
    assert one != "a take"
    n_changed = 0
    for field in dataclasses.fields(Take):
        other = changed(getattr(one, field.name))
        if other is not None:
            n_changed += 1
            assert dataclasses.replace(one, **{field.name: other}) != same, field.name
    assert n_changed >= 7
    assert dataclasses.replace(one, markers=tuple(f"n{k}" for k in range(len(one.markers)))) != same
    if one.skeleton is not None:
        assert (
            dataclasses.replace(one, skeleton=dataclasses.replace(one.skeleton, before=one.skeleton.before + 1)) != one
        )
    assert mocapclean.detect(one) != one
    assert mocapclean.detect(one) == mocapclean.detect(same)


def test_nan_is_equal_to_nan_and_takes_have_no_hash(walk):
    holes = dataclasses.replace(walk, positions=walk.to_numpy())
    assert holes == dataclasses.replace(walk, positions=walk.to_numpy())
    assert holes != walk
    with pytest.raises(TypeError, match="unhashable"):
        hash(walk)


def test_the_package_shows_its_public_names():
    assert dir(mocapclean) == sorted(mocapclean.__all__)
    assert {"read", "detect", "fill", "write", "Take", "FillResult", "Status", "from_xarray"} <= {*dir(mocapclean)}
    for name in mocapclean.__all__:
        assert getattr(mocapclean, name) is not None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"trusted": np.ones((480, 41), dtype=int)}, "trusted must be bool"),
        ({"rate": 0.0}, "rate must be positive"),
        ({"rate": np.nan}, "rate must be positive"),
    ],
)
def test_a_take_without_sense_is_refused(walk, change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(walk, **change)


@pytest.mark.parametrize("function", ["detect", "fill"])
def test_a_path_is_no_take(function):
    with pytest.raises(UsageError, match=rf"{function} takes a Take.* Got str"):
        getattr(mocapclean, function)("walk.c3d")
