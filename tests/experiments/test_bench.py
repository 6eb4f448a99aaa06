"""The papers' experiments: their protocols, and results that survive interruptions."""

import csv
import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from mocapclean.errors import SolverError, UsageError
from mocapclean.experiments import compare, hu2017, imamura2018, markers, plots, tan2015, trials, wang2016
from mocapclean.experiments.protocols import EXPERIMENTS
from mocapclean.experiments.published import published, statements
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Row, geometric_mean, number, with_printed
from mocapclean.experiments.trials import CMU_UNIT, Capture, Entry, Loss, Request
from mocapclean.formats import c3d
from mocapclean.simulate import hide, perform
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method
from tests import commands

LINEAR = Entry(method="linear")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three takes of two subjects, two seconds each."""
    folder = tmp_path_factory.mktemp("takes")
    for seed, name in enumerate(("7_01", "7_02", "8_01")):
        c3d.create(perform("walk", 2.0, 120.0, seed).markers, folder / f"{name}.c3d")
    return folder


@pytest.fixture
def capture(folder):
    return Capture(path=folder / "7_01.c3d")


run = partial(commands.run, "bench")


def rows_of(path):
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def timeless(path):
    return [{key: value for key, value in row.items() if key != "seconds"} for row in rows_of(path)]


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_gives_rows_tables_and_figures(name, folder, skeletons, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(plots, "can_draw", lambda: True)
    monkeypatch.setattr(plots, "draw", lambda figure, out: drawn.append(figure) or [])
    takes = skeletons if name == "skeletons" else folder
    arguments = (name, "7_01", "--folder", takes, "--quick", "--methods", "linear", "--out-dir", tmp_path)
    code, text, err = run(*arguments)
    assert (code, err) == (0, "")
    assert text.startswith(f"{name}: {EXPERIMENTS[name].EXPERIMENT.reference}")
    assert (tmp_path / f"{name}.txt").read_text(encoding="utf-8") == text
    rows = rows_of(tmp_path / f"{name}.csv")
    report = json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8"))
    assert len(rows) == len(report["rows"]) > 0
    assert {row["method"] for row in rows} == {"linear"}
    assert drawn
    assert all(
        panel.curves or panel.picture is not None or "rank" in panel.y_label for f in drawn for panel in f.panels
    )
    before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    assert run(*arguments)[0] == 0
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


def test_figures_are_drawn_to_the_same_bytes(tmp_path):
    pytest.importorskip("matplotlib")
    lines = Panel(title="lines", x_label="s", y_label="mm", curves=(Curve(label="a", x=[1, 2], y=[3, 4]),), log_x=True)
    gaps = Panel(title="gaps", x_label="s", y_label="joint", picture=np.array([[1.0, np.nan]]), ticks=("root",))
    figure = Figure(name="both", title="Both", panels=(lines, gaps))
    first = [path.read_bytes() for path in plots.draw(figure, tmp_path)]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["both.png", "both.svg"]
    assert first[0].startswith(b"\x89PNG")
    assert b"<svg" in first[1]
    assert [path.read_bytes() for path in plots.draw(figure, tmp_path)] == first


def test_an_interrupted_run_goes_on_to_the_same_rows(folder, tmp_path, monkeypatch):
    arguments = (
        "compare",
        folder / "7_01.c3d",
        "--methods",
        "linear,spline",
        "--seeds",
        "3",
        "--no-plots",
        "--out-dir",
    )
    assert run(*arguments, tmp_path / "whole")[0] == 0
    solve, calls = SOLVERS["spline"].solve, []

    def interrupted(*args):
        calls.append(args)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return solve(*args)

    monkeypatch.setattr(SOLVERS["spline"], "solve", interrupted)
    code, _, err = run(*arguments, tmp_path / "parts")
    assert (code, "Interrupted" in err) == (130, True)
    kept = (tmp_path / "parts" / "compare.csv").read_text(encoding="utf-8")
    assert len(kept.splitlines()) == 1 + 3
    assert run(*arguments, tmp_path / "parts")[0] == 0
    assert len(calls) == 2 + 2
    assert (tmp_path / "parts" / "compare.csv").read_text(encoding="utf-8").startswith(kept)
    assert timeless(tmp_path / "parts" / "compare.csv") == timeless(tmp_path / "whole" / "compare.csv")


def test_printed_values_stand_beside_ours():
    cell = {"loss": "blocks", "length": "15", "out": "3"}
    values = {"rmse": 0.114, "rmse_restored": 0.057, "seconds": 78.0, "iterations": 5.0, "skeleton_rmse": 1.0}
    row = Row(take="49_02", method="bolero", variant="", parameters="{}", cell=cell, seed=0, values=values, series=dict)
    table1, table2, _ = tan2015.tables(Results((row,)))
    assert table1.rows == (
        ("49_02", "bolero", "ours", "0.114", "2.00"),
        ("49_02", "bolero", "restored", "0.0570", "1.00"),
        ("49_02", "bolero", "printed", "0.0570", ""),
    )
    assert table2.rows == (("49_02", "bolero", "5.00", "78.0", "156", "0.500"),)


def test_a_torn_line_is_run_again_and_overwrite_forgets(folder, tmp_path):
    arguments = (
        "compare",
        folder / "7_01.c3d",
        "--methods",
        "linear",
        "--seeds",
        "2",
        "--no-plots",
        "--out-dir",
        tmp_path,
    )
    run(*arguments)
    path = tmp_path / "compare.csv"
    whole = timeless(path)
    path.write_text(path.read_text(encoding="utf-8")[:-20], encoding="utf-8")
    assert run(*arguments)[0] == 0
    assert timeless(path) == whole
    path.write_text("of,another,version\n", encoding="utf-8")
    code, _, err = run(*arguments)
    assert code == 2
    assert "--overwrite" in err
    assert run(*arguments, "--overwrite")[0] == 0
    assert timeless(path) == whole


def test_parameters_are_part_of_the_key(folder, tmp_path):
    arguments = ("compare", folder / "7_01.c3d", "--methods", "svt", "--quick", "--no-plots", "--out-dir", tmp_path)
    run(*arguments, "--set", "methods.svt.max_iterations=2")
    run(*arguments, "--set", "methods.svt.max_iterations=3", "--set", "methods.svt.origin=file")
    found = [json.loads(row["parameters"]) for row in rows_of(tmp_path / "compare.csv")]
    assert found == [{"max_iterations": 2}, {"max_iterations": 3, "origin": "file"}]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--methods", "magic"), "a method must be one of"),
        (("--methods", "llc"), "llc needs a trained dictionary"),
        (("--set", "methods.svt.step=1"), "--set must name a method of this run"),
        (("--set", "methods.linear.width=1"), "unknown key 'methods.linear.width'"),
        (("--methods", "trnn2", "--set", "methods.trnn2.max_iterations=many"), "trnn2.max_iterations"),
        (("--set", "step=1"), "--set must be methods.METHOD.PARAMETER=value"),
        (("--set", "svt.step=1"), "--set must be methods.METHOD.PARAMETER=value"),
        (("--unit", "yards"), "--unit must be"),
        (("--folder", "nowhere"), "--folder must be a folder"),
    ],
)
def test_wrong_usage_is_told_and_nothing_is_written(arguments, said, folder, tmp_path):
    code, _, err = run("compare", folder / "7_01.c3d", *arguments, "--out-dir", tmp_path / "out")
    assert code == 2
    assert said in err
    assert not (tmp_path / "out").exists()


def test_takes_must_be_there_and_have_different_names(folder, tmp_path):
    assert run("compare", "--out-dir", tmp_path)[0] == 2
    assert run("compare", "nobody", "--folder", folder, "--out-dir", tmp_path)[0] == 2
    code, _, err = run("compare", folder / "7_01.c3d", folder / "7_01.c3d", "--out-dir", tmp_path)
    assert (code, "different names" in err) == (2, True)


def test_a_method_that_fails_is_told_and_the_rest_goes_on(folder, tmp_path, monkeypatch):
    def fail(*args):
        raise SolverError("it must work. Got nothing.")

    monkeypatch.setattr(SOLVERS["spline"], "solve", fail)
    arguments = ("compare", folder / "7_01.c3d", "--methods", "linear,spline", "--seeds", "2", "--no-plots")
    code, text, err = run(*arguments, "--out-dir", tmp_path)
    assert code == 1
    assert err.count("it must work") == 1
    assert [row["method"] for row in rows_of(tmp_path / "compare.csv")] == ["linear", "linear"]
    assert "spline" not in text


def test_without_matplotlib_all_but_the_plots_is_there(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(plots, "find_spec", lambda name: None)
    code, _, err = run("compare", folder / "7_01.c3d", "--quick", "--methods", "linear", "--out-dir", tmp_path)
    assert code == 0
    assert "pip install '.[plots]'" in err
    assert {path.name for path in tmp_path.iterdir()} == {"compare", "compare.csv", "compare.json", "compare.txt"}


def test_tan_takes_every_second_frame_cut_to_a_multiple(capture):
    take = capture.take
    short = tan2015.every_second_frame(take, 50)
    np.testing.assert_array_equal(short.positions, take.positions[::2][:100])
    assert short.rate == 60.0
    with pytest.raises(SolverError, match="must have 400 frames"):
        tan2015.every_second_frame(take, 200)


def test_tan_divides_by_all_entries(capture):
    loss = Loss(length=15, out=3)
    truth = tan2015.every_second_frame(capture.take, 15)
    missing = loss.hidden(truth, 4)
    assert (missing.sum(axis=1) == 3).all()
    entry = Entry(method="svt", changes={"max_iterations": 5})
    found = run_method("svt", hide(truth, missing), trials.parameters(entry)).positions
    measures, _ = tan2015.run(capture, entry, loss, 4)
    every, lost = found - truth.positions, (found - truth.positions)[missing]
    assert measures["rmse"] == pytest.approx((every**2).mean() ** 0.5 / CMU_UNIT)
    assert measures["rmse_missing"] == pytest.approx((lost**2).mean() ** 0.5 / CMU_UNIT)
    assert measures["rmse_restored"] == pytest.approx(((lost**2).sum() / every.size) ** 0.5 / CMU_UNIT)
    assert measures["left"] == 0


def test_tan_keeps_the_joint_errors_of_the_loss_that_is_shown(capture):
    _, series = tan2015.run(capture, LINEAR, tan2015.SHOWN_LOSS, 0)
    joints = np.array([series[name] for name in capture.take.markers])
    np.testing.assert_allclose(series["rmse"], np.sqrt((joints**2).mean(axis=0) / 3), atol=1e-12)
    assert ((joints > 0).sum(axis=0) <= 3).all()


def test_imamura_measures_in_standard_deviations(capture):
    take = capture.take
    measures, series = imamura2018.run(capture, LINEAR, imamura2018.SHOWN_LOSS, 0)
    assert measures["rmse"] == pytest.approx(measures["rmse_mm"] / take.positions.std())
    second = np.diff(take.positions.reshape(len(take.positions), -1), n=2, axis=0) / take.positions.std()
    np.testing.assert_allclose(series["complete"], np.linalg.svd(second, compute_uv=False), atol=1e-9)
    assert series["broken"].sum() > series["repaired"].sum()


def test_wang_counts_markers_not_coordinates():
    truth, found = np.zeros((2, 3, 3)), np.zeros((2, 3, 3))
    found[0, 0] = (30.0, 40.0, 0.0)
    found[1, 2] = 1000.0
    where = np.array([[True, True, False], [False, False, False]])
    np.testing.assert_allclose(wang2016.frame_rmse(truth, found, where), [5.0 / 2**0.5, 0.0])


def test_wang_learns_from_the_same_subject_and_never_from_the_take(folder, tmp_path):
    code, text, _ = run(
        *("wang2016", "7_01", "8_01", "--folder", folder, "--quick", "--methods", "llc,linear", "--no-plots"),
        *("--out-dir", tmp_path),
    )
    assert code == 0
    assert "7_01 is tested; trained on: 7_02." in text
    assert "8_01 is tested; trained on: 7_01, 7_02." in text
    found = {
        (row["take"], row["method"], row["cell"]): float(row["rmse_cm"]) for row in rows_of(tmp_path / "wang2016.csv")
    }
    assert len(found) == 2 * 2 * 4
    assert all(value > 0 for value in found.values())


@pytest.mark.parametrize(
    ("extra", "expected"), [((), {150.0, 450.0, 1350.0}), (("--set", "methods.svt.threshold=99"), {0.0})]
)
def test_wang_tunes_a_competitor_unless_the_user_does(folder, tmp_path, extra, expected):
    code, text, _ = run(
        *("wang2016", "7_01", "--folder", folder, "--quick", "--methods", "svt", "--no-plots", "--out-dir", tmp_path),
        *extra,
    )
    assert code == 0
    assert "7_01 is tested; trained on: 7_02." in text or extra
    assert {float(row["tuned"]) for row in rows_of(tmp_path / "wang2016.csv")} <= expected


def test_wang_holds_out_all_takes_under_test_while_one_is_left(folder):
    names = ("7_01", "7_02", "8_01")
    seven, other, eight = (trials.Capture(path=folder / f"{name}.c3d") for name in names)
    assert wang2016.training_captures(seven, Request(captures=(seven,), folder=(other, eight))) == [other]
    assert wang2016.training_captures(seven, Request(captures=(seven, other), folder=(eight,))) == [other]


def test_wang_needs_another_take(capture):
    with pytest.raises(UsageError, match="at least one other take"):
        wang2016.trials(Request(captures=(capture,), methods=("llc",)))


def test_compare_judges_hidden_samples_only_and_those_at_the_ends_apart(capture):
    truth = capture.take
    missing = np.zeros_like(truth.trusted)
    missing[:9, 0] = missing[20:30, 1] = missing[40:80, 2] = missing[-7:, 3] = True

    class Given:
        def hidden(self, take, seed):
            return missing

    entry = Entry(method="svt", changes={"max_iterations": 5})
    measures, _ = compare.run(capture, entry, Given(), 0)
    found = run_method("svt", hide(truth, missing), trials.parameters(entry)).positions
    errors = found - truth.positions
    assert measures["rmse 1-10"] == pytest.approx((errors[20:30, 1] ** 2).mean() ** 0.5)
    assert measures["rmse 31-60"] == pytest.approx((errors[40:80, 2] ** 2).mean() ** 0.5)
    inside = np.concatenate([errors[20:30, 1], errors[40:80, 2]])
    assert measures["rmse inside"] == pytest.approx((inside**2).mean() ** 0.5)
    assert measures["rmse_3d"] == pytest.approx(3**0.5 * measures["rmse inside"])
    ends = np.concatenate([errors[:9, 0], errors[-7:, 3]])
    assert measures["rmse at ends"] == pytest.approx((ends**2).mean() ** 0.5)
    linear, _ = compare.run(capture, LINEAR, Given(), 0)
    assert linear["left"] == 16
    assert "rmse at ends" not in linear


def test_untrusted_samples_are_neither_hidden_nor_judged(capture):
    take = capture.take
    trusted = take.trusted.copy()
    trusted[50:90, :4] = False
    ruined = replace(take, trusted=trusted, positions=np.where(trusted[..., None], take.positions, 1e7))
    broken = replace(capture)
    broken.__dict__["take"] = ruined
    for loss in (Loss(ratio=0.3), Loss(length=20, out=5), compare.Occlusion()):
        assert not (loss.hidden(ruined, 0) & ~trusted).any()
    assert tan2015.run(broken, LINEAR, Loss(length=15, out=3), 0)[0]["rmse"] < 100
    assert hu2017.run(broken, LINEAR, Loss(ratio=0.3), 0)[0]["rmse"] < 100
    assert imamura2018.run(broken, LINEAR, Loss(ratio=0.3), 0)[0]["rmse"] < 100
    assert wang2016.run(broken, LINEAR, Loss(ratio=0.3), 0)[0]["rmse_cm"] < 1000
    assert compare.run(broken, LINEAR, compare.Occlusion(), 0)[0]["largest"] < 1e4
    assert markers.run(broken, LINEAR, markers.SHORT[2], 0)[0]["largest"] < 1e4


def test_a_loss_depends_on_its_seed_and_its_size_only(capture):
    take = capture.take
    np.testing.assert_array_equal(Loss(ratio=0.3).hidden(take, 1), Loss(ratio=0.3).hidden(take, 1))
    assert (Loss(ratio=0.3).hidden(take, 1) != Loss(ratio=0.3).hidden(take, 2)).any()
    assert (Loss(length=20, out=5).hidden(take, 1) != Loss(length=20, out=5).hidden(take, 2)).any()


def test_a_shortened_capture_has_another_key(capture):
    (short,) = Request(captures=(capture,), quick=True).shortened(60).captures
    assert len(short.take.trusted) == 60
    assert short.digest != capture.digest
    assert Request(captures=(capture,)).shortened(60).captures == (capture,)
    assert short.shortened(100) == short
    assert short.shortened(50).digest != short.digest


def test_synthetic_matrices_are_separated():
    low, matrix = hu2017.synthetic(10, 0.1, 0)
    assert np.linalg.matrix_rank(low) == 10
    assert 0.09 < np.mean(low != matrix) < 0.11
    for name in hu2017.SYNTHETIC:
        measures, _ = hu2017._separate(name, 10, 0.1, 0)
        assert measures["nre"] < 1e-5, name


def test_printed_tables_are_whole():
    rows = published("tan2015_table1")
    assert len(rows) == 8 * 3 * 10
    assert {row["method"] for row in rows} <= set(SOLVERS)
    cell = {"take": "49_02", "method": "scsvt", "out": "3", "length": "120", "rmse": "0.093"}
    assert cell in rows
    assert len(published("tan2015_table2")) == 8 * 4
    assert {row["take"] for row in rows} == set(EXPERIMENTS["tan2015"].EXPERIMENT.sequences)
    assert len(published("hu2017_seconds")) == 6
    of_no_paper = ("compare", "markers", "occlusion", "trust", "harm", "skeletons")
    assert all(statements(name) for name in EXPERIMENTS if name not in of_no_paper)


def test_ours_beside_theirs():
    assert geometric_mean([2.0, 0.5]) == pytest.approx(1.0)
    assert with_printed([0.2, 0.1, None], [0.1, None, 0.3]) == (
        ["0.200", "0.100", "-"],
        ["0.100", "-", "0.300"],
        "2.00",
    )
    assert [number(x) for x in (None, 0.0, 0.01234, 12.345, 1234.5)] == ["-", "0", "0.0123", "12.3", "1234"]


def test_every_entry_of_the_papers_is_a_valid_one():
    own = (*tan2015.ENTRIES, *tan2015.PRINTED_STEPS, *hu2017.ENTRIES, *imamura2018.ENTRIES, *wang2016.ENTRIES)
    for entry in own:
        params = trials.parameters(entry)
        assert all(getattr(params, name) == value for name, value in entry.changes.items())
