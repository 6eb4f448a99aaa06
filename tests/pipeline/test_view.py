"""The view of a take: what is in the file and in the output, its neighbours and its vertical."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import SAMPLES

import mocapclean
from mocapclean import formats
from mocapclean.config.loading import resolve
from mocapclean.pipeline.repair import repair
from mocapclean.pipeline.view import View
from mocapclean.take.status import Status, detected


@pytest.fixture(scope="module")
def walk():
    return mocapclean.detect(mocapclean.read(SAMPLES / "walk.c3d"))


def view_of(take):
    return View(before=take, after=take, codes=detected(take))


def test_a_repair_gives_its_view_and_the_same_output(tmp_path):
    settings = resolve(None, {"method": "spline"})
    views = []
    seen = repair(SAMPLES / "walk.c3d", tmp_path / "seen.c3d", settings, keep=views.append)
    unseen = repair(SAMPLES / "walk.c3d", tmp_path / "unseen.c3d", settings)
    assert seen.output_sha256 == unseen.output_sha256
    (view,) = views
    written = mocapclean.read(tmp_path / "seen.c3d")
    assert np.array_equal(view.in_output, written.trusted)
    assert np.array_equal(view.after.positions[view.in_output], written.positions[view.in_output])
    assert np.array_equal(view.in_file, mocapclean.read(SAMPLES / "walk.c3d").trusted)


def test_what_was_distrusted_is_in_the_file_and_what_is_invalidated_is_not_in_the_output(walk):
    codes = detected(walk)
    trusted = walk.trusted.copy()
    trusted[10:20, 0] = False
    codes[10:20, 0] = Status.POOR
    distrusted = replace(walk, trusted=trusted)
    view = View(before=distrusted, after=distrusted, codes=codes)
    assert view.in_file[10:20, 0].all()
    assert view.in_output[10:20, 0].all()
    assert not replace(view, invalidated=True).in_output[10:20, 0].any()


def test_neighbours_keep_their_distance(walk):
    neighbours = view_of(walk).neighbours()
    assert len(neighbours) == len(walk.markers)
    of_head = {walk.markers[column] for column in neighbours[walk.markers.index("LFHD")]}
    assert {"RFHD", "LBHD", "RBHD"} <= of_head
    assert all(marker not in others and len(others) <= 4 for marker, others in enumerate(neighbours))


def test_the_vertical_is_found_whichever_axis_it_is(walk):
    assert view_of(walk).up_axis() == 2
    turned = replace(walk, positions=walk.positions[:, :, [2, 0, 1]] * [1, -1, 1])
    assert view_of(replace(walk, positions=walk.positions[:, :, [0, 2, 1]])).up_axis() == 1
    assert view_of(turned).up_axis() in (1, 2)
    beside = replace(walk, positions=walk.positions + np.array([0.0, 5000.0, 0.0]))
    two = replace(
        walk,
        positions=np.concatenate([walk.positions, beside.positions], axis=1),
        trusted=np.concatenate([walk.trusted] * 2, axis=1),
        filled=None,
        moved=None,
        detached=None,
        markers=(*walk.markers, *(f"B:{name}" for name in walk.markers)),
    )
    assert view_of(two).up_axis() == 2


def test_events_are_in_the_frames_of_the_take(captures):
    take = mocapclean.read(captures / "c3d" / "BTKData__PiG_PiG_Motion-FlatFoot-Hole.c3d")
    events = formats.events(take)
    assert [event.frame for event in events] == sorted(event.frame for event in events)
    assert {event.context for event in events} == {"Left", "Right"}
    # Vicon places events on whole frames.
    assert all(abs(event.frame - round(event.frame)) < 0.01 for event in events)
    assert formats.events(mocapclean.read(SAMPLES / "walk.bvh")) == ()
