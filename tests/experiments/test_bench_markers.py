"""The bench of markers: which takes and samples are used, and what is measured after a fill."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from mocapclean.experiments import markers
from mocapclean.experiments.results import Results
from mocapclean.experiments.trials import Capture, Entry
from mocapclean.formats import c3d
from mocapclean.simulate import perform
from mocapclean.solvers import SOLVERS
from mocapclean.take import Solution
from tests import commands
from tests.result_rows import result_row

LINEAR = Entry(method="linear")


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    path = tmp_path_factory.mktemp("takes") / "7_01.c3d"
    c3d.create(perform("walk", 2.0, 120.0, 0).markers, path)
    return Capture(path=path)


def test_markers_counts_gaps_and_what_intervals_hold(capture, monkeypatch):
    truth = capture.take
    missing = np.zeros_like(truth.trusted)
    missing[20:30, 1] = missing[40:80, 2] = missing[-7:, 3] = True

    class Given:
        def hidden(self, take, seed):
            return missing

    errors = np.zeros_like(truth.positions)
    errors[20:30, 1] = [3.0, 0.0, 4.0]
    errors[40:80, 2, 0] = np.linspace(0.0, 39.0, 40)
    sd = np.where(missing, 2.0, 0.0)
    solution = Solution(positions=truth.positions + errors, filled=missing, sd=sd)
    monkeypatch.setattr(SOLVERS["linear"], "solve", lambda *_: solution)
    measures, series = markers.run(capture, LINEAR, Given(), 0)
    inside = np.concatenate([errors[20:30, 1], errors[40:80, 2]])
    assert (measures["hidden"], measures["left"]) == (50, 0)
    assert measures["rmse"] == pytest.approx((inside**2).mean() ** 0.5)
    assert measures["coordinates 1-10"] == 30
    assert measures["covered 1-10"] == 20
    assert measures["coordinates 31-60"] == 120
    assert measures["covered 31-60"] == 120 - 36
    assert measures["squared 1-10"] == pytest.approx(10 * 25.0)
    assert measures["expected 31-60"] == pytest.approx(40 * 3 * 4.0)
    np.testing.assert_array_equal(series["frames"], [10, 40])
    np.testing.assert_allclose(series["error"], [5.0, (np.linspace(0.0, 39.0, 40) ** 2).mean() ** 0.5])
    np.testing.assert_allclose(series["expected"], 3**0.5 * 2.0)


def test_markers_sets_the_default_beside_the_best_other_of_each_case(monkeypatch):
    monkeypatch.setattr(markers, "DEFAULT_METHOD", "pma")
    rows = []
    for take, (best, other, line) in {"a": (1.0, 4.0, 2.0), "b": (9.0, 9.0, 9.0), "c": (6.0, 1.5, 3.0)}.items():
        rows += [result_row(take, "pma", best), result_row(take, "pca", other), result_row(take, "linear", line)]
    errors, ratios, harm, *_ = markers.tables(Results(tuple(rows)))
    assert ("chosen on", "pma", "2", "3.50 / 5.50", "-", "-", "3.50 / 5.50", "-", "-", "-") in errors.rows
    assert ("reported on", "pca", "1", "1.00", "-", "-", "1.00", "0.0 %") in ratios.rows
    assert ("chosen on", "best of them", "2", "1.41", "-", "-", "1.41", "50.0 %") in ratios.rows
    assert ("chosen on", "pma", "2", "50.0 %", "3.00", "0", "-", "-") in harm.rows


def test_markers_uses_what_has_a_label_and_is_seen_in_half_of_the_frames():
    take = perform("walk", 4.0, 120.0, 0).markers
    trusted, detached = take.trusted.copy(), take.detached.copy()
    trusted[::2, 13] = trusted[5, 13] = False
    detached[[3, 8]] = True
    kept = markers.labelled(replace(take, trusted=trusted, detached=detached)).markers
    assert {*take.markers} - {*kept} == {take.markers[k] for k in (3, 8, 13)}


def test_markers_takes_of_a_folder_what_is_fit_and_says_why_not(tmp_path, rng):
    good = perform("walk", 3.0, 120.0, 5).markers
    c3d.create(good, tmp_path / "good.c3d")
    c3d.create(replace(good, rate=60.0), tmp_path / "slow.c3d")
    c3d.create(good.crop(0, 250), tmp_path / "short.c3d")
    c3d.create(good.select(np.arange(12)), tmp_path / "few.c3d")
    still = good.positions[0] + rng.normal(0.0, 0.3, good.positions.shape)
    c3d.create(replace(good, positions=still), tmp_path / "still.c3d")
    trusted = good.trusted.copy()
    trusted[:100, ::4] = False
    c3d.create(replace(good, trusted=trusted), tmp_path / "gappy.c3d")
    (tmp_path / "broken.c3d").write_bytes(b"nothing")
    (tmp_path / "other.bvh").write_bytes(b"nothing")
    arguments = ("--methods", "linear", "--seeds", "1", "--no-plots", "--out-dir", tmp_path / "o")
    code, text, _ = commands.run("bench", "markers", "--folder", tmp_path, *arguments)
    assert code == 0
    assert "chosen on: good\n" in text
    for said in (
        "slow.c3d (60 Hz)",
        "short.c3d (250 frames)",
        "few.c3d (12 labelled markers)",
        "still.c3d (no motion)",
        f"gappy.c3d ({100 * (1 - trusted.mean()):.1f} % missing)",
        "broken.c3d (cannot be read)",
        "other.bvh (no markers)",
    ):
        assert said in text
    with (tmp_path / "o" / "markers.csv").open(encoding="utf-8") as file:
        assert {row["take"] for row in csv.DictReader(file)} == {"good"}


def test_markers_alternates_the_takes():
    assert markers.halves(["c", "a", "d", "b", "e"]) == {"chosen on": ["a", "c", "e"], "reported on": ["b", "d"]}


def test_scattered_gaps_are_short_and_off_the_ends(capture):
    missing = markers.ScatteredGaps(count=30, longest=10).hidden(capture.take, 3)
    assert not missing[:10].any()
    assert not missing[-10:].any()
    assert 30 <= missing.sum() <= 300
    assert (missing != markers.ScatteredGaps(count=30, longest=10).hidden(capture.take, 4)).any()
