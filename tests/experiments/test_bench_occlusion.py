"""The bench of occlusion: which samples are hidden together, and what is measured after a fill."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from mocapclean.experiments import occlusion
from mocapclean.experiments.occlusion import CameraRing, Cluster, NaturalMask
from mocapclean.experiments.results import Results
from mocapclean.experiments.trials import Capture, Entry
from mocapclean.formats import c3d
from mocapclean.simulate import hide, occlude_by_cameras, perform
from mocapclean.solvers import SOLVERS
from mocapclean.take import Solution
from tests import commands
from tests.result_rows import result_row

LINEAR = Entry(method="linear")


@pytest.fixture(scope="module")
def walk():
    return perform("walk", 4.0, 120.0, 0).markers


@pytest.fixture(scope="module")
def gappy(walk, tmp_path_factory):
    """A capture in which three markers are lost together, another one overlaps with them, and a fifth is lost later."""
    missing = np.zeros_like(walk.trusted)
    missing[100:160, [5, 20, 30]] = True
    missing[150:170, 12] = True
    missing[300:400, 7] = True
    path = tmp_path_factory.mktemp("gappy") / "gappy.c3d"
    c3d.create(hide(walk, missing), path)
    return Capture(path=path)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("cluster", [p for p in occlusion.PATTERNS if isinstance(p, Cluster)])
def test_a_cluster_is_a_marker_and_its_nearest_ones_at_about_the_same_time(walk, cluster, seed):
    hidden = cluster.hidden(walk, seed)
    np.testing.assert_array_equal(hidden, cluster.hidden(walk, seed))
    members = np.flatnonzero(hidden.any(axis=0))
    assert len(members) == cluster.out
    distance = np.linalg.norm(walk.positions[:, :, None] - walk.positions[:, None], axis=3)
    nearness = distance.mean(axis=0) + 2 * distance.std(axis=0)
    clusters = [set(np.argsort(row)[: cluster.out].tolist()) for row in nearness]
    assert set(members.tolist()) in clusters
    starts = hidden[:, members].argmax(axis=0)
    assert np.ptp(starts) <= 2 * (cluster.length // 4)
    if cluster.at_end:
        assert hidden[-cluster.length :, members].all()
        assert not hidden[: -cluster.length].any()
    else:
        assert (hidden[:, members].sum(axis=0) >= cluster.length - occlusion._MARGIN).all()
        assert not hidden[[0, -1]].any()


def test_samples_that_are_missing_in_the_take_are_not_hidden(walk):
    trusted = walk.trusted.copy()
    trusted[::3] = False
    for pattern in occlusion.PATTERNS:
        assert not (pattern.hidden(replace(walk, trusted=trusted), 0) & ~trusted).any()


def test_what_cameras_hardly_ever_see_is_not_hidden(walk):
    lost = occlude_by_cameras(walk, np.random.default_rng([3, 6]), 6)
    hidden = CameraRing(cameras=6).hidden(walk, 3)
    often = lost.mean(axis=0) >= occlusion._MOST_LOSS
    assert often.any()
    assert lost.any(axis=0)[~often].any()
    np.testing.assert_array_equal(hidden, lost & ~often)


def test_what_a_capture_loses_together_is_lost_together_by_neighbours(walk, gappy):
    near = occlusion.neighbours(walk)
    places = set()
    for seed in range(5):
        hidden = NaturalMask(capture=gappy).hidden(walk, seed)
        # The capture's own first frame is kept; it has as many frames as the take.
        columns = np.flatnonzero(hidden.any(axis=0))
        lost = {(int(c.argmax()), int(c.sum())) for c in hidden.T[columns]}
        assert lost == {(100, 60), (150, 20), (300, 100)}
        together = columns[hidden[120, columns]]
        assert len(together) == 3
        (first,) = columns[hidden[350, columns]]
        assert set(near[first, : len(columns)].tolist()) == set(columns.tolist())
        places.add(int(first))
    assert len(places) > 1


def test_a_mask_of_a_longer_capture_is_cut_and_one_of_a_shorter_leaves_the_rest(walk, gappy):
    mask = NaturalMask(capture=gappy)
    assert NaturalMask(capture=gappy).hidden(walk.crop(0, 200), 1).shape == (200, 41)
    twice = {name: np.concatenate([getattr(walk, name)] * 2) for name in ("positions", "trusted", "filled", "moved")}
    longer = replace(walk, **twice)
    hidden = mask.hidden(longer, 1)
    assert hidden.shape == longer.trusted.shape
    assert not hidden[len(walk.trusted) :].any()


def test_the_worst_pair_is_the_largest_deviation_of_a_rigid_distance(monkeypatch, walk, tmp_path):
    positions = walk.positions.copy()
    # A rigid pair on top of a moving marker, 100 mm apart, and all others as they are
    positions[:, 1] = positions[:, 0] + [100.0, 0.0, 0.0]
    path = tmp_path / "rigid.c3d"
    c3d.create(replace(walk, positions=positions), path)
    capture = Capture(path=path)
    truth = capture.take
    missing = np.zeros_like(truth.trusted)
    missing[50:90, 1] = True

    class Given:
        def hidden(self, take, seed):
            return missing

    def solved(shift):
        filled = truth.positions + np.where(missing[..., None], shift, 0.0)
        solution = Solution(positions=filled, filled=missing, sd=np.where(missing, 4.0, 0.0))
        monkeypatch.setattr(SOLVERS["linear"], "solve", lambda *_: solution)
        return occlusion.run(capture, LINEAR, Given(), 0)[0]

    true, out, across = solved([0.0, 0.0, 0.0]), solved([50.0, 0.0, 0.0]), solved([0.0, 75.0, 0.0])
    assert (out["hidden"], out["left"]) == (40, 0)
    assert true["pair"] == pytest.approx(true["pair_truth"])
    assert out["pair"] == pytest.approx(50.0, abs=true["pair_truth"] + 0.1)
    assert across["pair"] >= 25.0 - 0.1
    assert out["pair_truth"] == across["pair_truth"] == true["pair_truth"]
    assert out["rmse"] == pytest.approx(50.0 / 3**0.5)
    assert out["squared 31-60"] == pytest.approx(40 * 2500.0)
    assert out["expected 31-60"] == pytest.approx(40 * 48.0)


def row(take, method, error, left=0.0, pattern="3n60", **values):
    return result_row(take, method, error, pattern, **{"left": left, "hidden": 100.0, "seconds": 1.0, **values})


def test_a_method_is_set_beside_the_best_other_that_leaves_no_more():
    chosen, other = occlusion.CHOSEN[0], "a take of no list"
    rows = [
        row(chosen, "kriging", 2.0, pair=6.0, pair_truth=3.0, **{"coordinates 31-60": 30, "covered 31-60": 24}),
        row(chosen, "pma", 8.0),
        row(chosen, "linear", 1.0, left=5.0),
        row(other, "kriging", 3.0, **{"squared 31-60": 400.0, "expected 31-60": 100.0}),
        row(other, "pma", 1.0),
    ]
    table = occlusion.tables(Results(tuple(rows)))[0]
    found = {(line[0], line[2]): dict(zip(table.header, line, strict=True)) for line in table.rows}
    assert found["chosen on", "kriging"]["/ best other"] == "0.250"
    assert found["chosen on", "linear"]["/ best other"] == "0.500"
    assert found["chosen on", "linear"]["left"] == "5.0 %"
    assert found["chosen on", "kriging"]["within 90 %"] == "80.0 %"
    assert [found["chosen on", "kriging"][name] for name in ("pair", "in truth", "ratio")] == ["6.00", "3.00", "2.00"]
    assert found["reported on", "kriging"]["/ best other"] == "3.00"
    assert found["reported on", "kriging"]["/ expected"] == "2.00"


def test_no_take_is_in_both_halves():
    lists = (*occlusion.CHOSEN, *occlusion.REPORTED, *occlusion.GAPPY)
    assert len({*lists}) == len(lists)
    assert min(len(occlusion.CHOSEN), len(occlusion.REPORTED)) >= 4


def test_every_listed_capture_is_run(captures):
    folder = captures / "c3d"
    for name in (*occlusion.CHOSEN, *occlusion.REPORTED):
        assert occlusion._reason_to_skip(Capture(path=folder / f"{name}.c3d")) == "", name
    for name in occlusion.GAPPY:
        take = occlusion._labelled(Capture(path=folder / f"{name}.c3d")).take
        assert (~take.trusted).mean() > 0.02, name


def test_the_command_takes_masks_and_the_first_frames(walk, gappy, tmp_path):
    path = tmp_path / "clean.c3d"
    c3d.create(walk, path)
    arguments = ("--methods", "linear", "--seeds", "1", "--no-plots", "--out-dir", tmp_path / "out")
    code, text, err = commands.run(
        "bench", "occlusion", path, "--most-frames", "240", "--mask-from", gappy.path, *arguments
    )
    assert (code, err) == (0, "")
    assert "at most 240 frames" in text
    assert "masks of: gappy" in text
    assert "natural masks" in text
    with (tmp_path / "out" / "occlusion.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(occlusion.PATTERNS) + 1
    assert {row["source"].split(":")[1] for row in rows} == {"240"}
    code, _, err = commands.run("bench", "compare", path, "--mask-from", gappy.path, *arguments)
    assert code == 2
    assert "--mask-from must be left out" in err
