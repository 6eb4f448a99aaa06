"""The commands, as a user types them: what they write, what they print, how they end."""

import json
import re
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import mocapclean
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method
from tests.commands import files_in, launch, run

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "sample_data"
SCHEMA = json.loads((ROOT / "docs" / "report.schema.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", ["walk.c3d", "walk.bvh", "walk_01.amc"])
def test_fill_writes_the_repaired_file_and_its_report_and_nothing_else(folder, name):
    before = files_in(folder)
    code, out, err = run("fill", folder / name, "--method", "linear")
    assert (code, err) == (0, "")
    assert re.search(r"filled +[1-9][0-9,]* samples by linear", out)
    after = files_in(folder)
    stem, suffix = name.rsplit(".", 1)
    assert set(after) - set(before) == {f"{stem}_filled.{suffix}", f"{stem}_filled.{suffix}.report.json"}
    assert all(after[kept] == content for kept, content in before.items())
    report = json.loads(after[f"{stem}_filled.{suffix}.report.json"])
    jsonschema.validate(report, SCHEMA)
    (take,) = report["takes"]
    assert take["status"] == "repaired"
    assert take["counts"]["filled"] == sum(gap["samples_filled"] for gap in take["gaps"]) > 0
    assert take["counts"]["untrusted"] == sum(gap["length"] for gap in take["gaps"])
    assert take["counts"]["left"] == take["counts"]["untrusted"] - take["counts"]["filled"]


def test_a_reference_gives_the_error_of_what_was_written(folder):
    code, out, _ = run("fill", folder / "walk.c3d", "--method", "spline", "--reference", folder / "walk_truth.c3d")
    assert code == 0
    assert "mm per coordinate" in out
    (take,) = json.loads((folder / "walk_filled.c3d.report.json").read_text())["takes"]
    truth, broken, filled = (mocapclean.read(folder / f"{name}.c3d") for name in ("walk_truth", "walk", "walk_filled"))
    where = ~broken.trusted & filled.trusted & truth.trusted
    expected = np.sqrt(np.mean((truth.positions[where] - filled.positions[where]) ** 2))
    assert take["accuracy"]["filled"]["rmse"] == pytest.approx(expected, rel=1e-6)
    by_length = take["accuracy"]["by_gap_length"].values()
    assert sum(found["samples"] for found in by_length) == take["accuracy"]["filled"]["samples"] == where.sum()


def test_nothing_to_fill_gives_an_identical_file(folder):
    code, out, _ = run("fill", folder / "walk_truth.c3d", "--no-detect", "-o", folder / "same.c3d")
    assert code == 0
    assert "nothing to fill" in out
    assert (folder / "same.c3d").read_bytes() == (folder / "walk_truth.c3d").read_bytes()


def test_spans_limits_and_choices_of_markers(folder):
    (folder / "bad.csv").write_text("marker,first,last\nLELB,20,29\nRELB,20,25\n")
    arguments = ("--gaps", folder / "bad.csv", "--no-detect", "--method", "linear", "--max-gap", "8")
    code, out, _ = run("fill", folder / "walk_truth.c3d", *arguments, "-o", folder / "out.c3d")
    assert code == 0
    assert "10 longer than the limit" in out
    truth, got = mocapclean.read(folder / "walk_truth.c3d"), mocapclean.read(folder / "out.c3d")
    moved = (truth.positions != got.positions).any(axis=2)
    assert moved[19:25, truth.markers.index("RELB")].all()
    assert moved.sum() == 6
    code, out, _ = run("fill", folder / "walk_truth.c3d", *arguments, "--markers", "L*", "-o", folder / "l.c3d")
    assert "6 not asked for" in out
    assert (folder / "l.c3d").read_bytes() == (folder / "walk_truth.c3d").read_bytes()


def test_left_samples_fail_only_when_a_limit_was_asked_for(folder):
    code, _, err = run("fill", folder / "walk.c3d", "--max-gap", "2", "--method", "linear", "--max-left", "1%")
    assert code == 1
    assert "more than --max-left 1%" in err
    code, _, err = run("fill", folder / "walk.c3d", "--max-gap", "2", "--method", "linear", "--overwrite")
    assert (code, err) == (0, "")


# ---- error bars

QUICK = ("states=6", "state_schedule=[]", "max_iterations=8")
WITH_BARS = (
    "--method",
    "dynammo",
    "--no-self-check",
    "--fill-poor",
    *(part for assignment in QUICK for part in ("--set", assignment)),
)


def taken(path):
    """The only take of a report that keeps its schema."""
    report = json.loads(path.read_text(encoding="utf-8"))
    jsonschema.validate(report, SCHEMA)
    return report["takes"][0], report["totals"]


def test_expected_errors_and_grades(folder):
    code, out, _ = run("fill", folder / "walk.c3d", *WITH_BARS, "--set", "grades.good=10.05", "-v")
    assert code == 0
    take, totals = taken(folder / "walk_filled.c3d.report.json")
    filled = mocapclean.detect(mocapclean.read(folder / "walk.c3d"))
    solution = run_method("dynammo", filled, SOLVERS["dynammo"].Params(states=6, state_schedule=(), max_iterations=8))
    for gap in take["gaps"]:
        sd = solution.sd[gap["first"] - 1 : gap["last"], filled.markers.index(gap["marker"])]
        assert gap["expected_3d"] == pytest.approx(np.sqrt(3 * np.mean(sd**2)))
        assert gap["grade"] == ("good" if gap["expected_3d"] <= 10.05 else "fair")
    counts = {name: sum(gap["grade"] == name for gap in take["gaps"]) for name in ("good", "fair", "poor")}
    assert counts == {name: totals[name] for name in counts}
    assert counts["good"] > 0 < counts["fair"]
    assert f"{counts['good']} gaps good, {counts['fair']} gaps fair" in out
    assert "expected 3D mm  grade" in out


def test_gaps_of_a_large_expected_error_are_left(folder):
    code, out, _ = run("fill", folder / "walk.c3d", *WITH_BARS, "--max-error", "10.1")
    assert code == 0
    take, totals = taken(folder / "walk_filled.c3d.report.json")
    left = [gap for gap in take["gaps"] if gap["expected_3d"] > 10.1]
    assert 0 < len(left) < len(take["gaps"])
    assert {gap["left_because"] for gap in left} == {"the expected error is above the limit"}
    assert all(gap["samples_filled"] == 0 and gap["grade"] is None for gap in left)
    assert all(gap["filled"] for gap in take["gaps"] if gap not in left)
    assert totals["left"] == sum(gap["length"] for gap in left)
    assert f"{totals['left']} the expected error is above the limit" in out
    got = mocapclean.read(folder / "walk_filled.c3d")
    assert (~got.trusted).sum() == totals["left"]


def test_a_method_without_error_bars_gives_no_grades(folder):
    code, out, _ = run("fill", folder / "walk.c3d", "--method", "linear", "-v")
    assert code == 0
    assert "grade" not in out
    take, totals = taken(folder / "walk_filled.c3d.report.json")
    assert {(gap["expected_3d"], gap["grade"]) for gap in take["gaps"]} == {(None, None)}
    assert totals["gaps"] == len(take["gaps"])
    assert totals["good"] == totals["fair"] == totals["poor"] == 0


# ---- the self-check


def test_interpolations_check_themselves(folder):
    code, out, _ = run("fill", folder / "walk.c3d", "--method", "spline")
    assert code == 0
    found = taken(folder / "walk_filled.c3d.report.json")[0]["self_check"]
    assert "self-check" in out
    assert (found["because"], found["rounds"]) == ("", 1)
    assert found["total"]["gaps"] == sum(check["gaps"] for check in found["by_length"].values()) > 30
    assert found["total"]["samples"] == sum(check["samples"] for check in found["by_length"].values())
    assert found["total"]["covered"] is None
    assert "within 90 %" not in out
    errors = [check["error"]["rmse"] for name, check in found["by_length"].items() if name in ("1-10", "31-60")]
    assert errors == sorted(errors)


def test_the_self_check_is_near_the_true_error(folder):
    run("fill", folder / "walk.c3d", "--method", "linear", "--reference", folder / "walk_truth.c3d")
    take, _ = taken(folder / "walk_filled.c3d.report.json")
    assert 0.5 < take["self_check"]["total"]["error"]["rmse"] / take["accuracy"]["filled"]["rmse"] < 2.0


def test_the_self_check_can_be_switched(folder):
    arguments = ("fill", folder / "walk.c3d", "--overwrite")
    code, out, _ = run(*arguments, "--method", "linear", "--no-self-check")
    assert code == 0
    assert "self-check" not in out
    assert taken(folder / "walk_filled.c3d.report.json")[0]["self_check"] is None
    without = (folder / "walk_filled.c3d").read_bytes()
    run(*arguments, "--method", "linear")
    assert (folder / "walk_filled.c3d").read_bytes() == without
    run(*arguments, *WITH_BARS)
    assert taken(folder / "walk_filled.c3d.report.json")[0]["self_check"] is None
    code, out, _ = run(*arguments, *WITH_BARS, "--self-check", "--set", "hiding.rounds=2")
    assert code == 0
    found = taken(folder / "walk_filled.c3d.report.json")[0]["self_check"]
    assert found["rounds"] == 2
    assert 0.5 < found["total"]["covered"] < 1.0
    assert "within 90 %" in out


def test_a_self_check_that_is_not_possible_says_why(folder):
    (folder / "bad.csv").write_text("marker,first,last\nLELB,10,470\n")
    options = ("--gaps", folder / "bad.csv", "--no-detect", "--method", "linear")
    code, out, _ = run("fill", folder / "walk_truth.c3d", *options)
    assert code == 0
    assert "self-check  not possible: none of the 1 gaps fits where its marker is trusted" in out
    assert "because" in taken(folder / "walk_truth_filled.c3d.report.json")[0]["self_check"]


# ---- method auto


def auto(*methods):
    """Options for auto with these candidates, dynammo a quick one."""
    quick = [f"methods.dynammo.{assignment}" for assignment in QUICK]
    assignments = [f"auto.methods=[{', '.join(methods)}]", *quick]
    return ("--method", "auto", *(part for assignment in assignments for part in ("--set", assignment)))


def test_auto_chooses_by_the_self_check(folder):
    arguments = ("fill", folder / "walk.c3d", "--overwrite")
    code, out, _ = run(*arguments, *auto("linear", "llc", "spline", "dynammo"))
    assert code == 0
    take, _ = taken(folder / "walk_filled.c3d.report.json")
    choice = take["choice"]
    chosen = choice["method"]
    written = (folder / "walk_filled.c3d").read_bytes()
    assert take["method"] == chosen
    assert f"{chosen}, chosen by auto" in out
    tried = {candidate["method"]: candidate for candidate in choice["candidates"]}
    assert list(tried) == ["linear", "llc", "spline", "dynammo"]
    assert "needs a trained dictionary" in tried["llc"]["left_out"]
    assert "llc is left out" in out
    most = max(found["total"]["error"]["samples"] for name, found in tried.items() if name != "llc")
    able = [name for name, found in tried.items() if name != "llc" and found["total"]["error"]["samples"] == most]
    assert chosen == min(able, key=lambda name: tried[name]["total"]["error"]["rmse_3d"])
    assert take["self_check"]["total"] == tried[chosen]["total"]
    with_bars = tuple(option for option in WITH_BARS if option != "--fill-poor")
    own = with_bars if chosen == "dynammo" else ("--method", chosen)
    run(*arguments, *own, "--self-check")
    again, _ = taken(folder / "walk_filled.c3d.report.json")
    assert again["self_check"] == take["self_check"]
    assert again["choice"] is None
    assert (folder / "walk_filled.c3d").read_bytes() == written


def test_auto_prefers_the_better_of_two_that_fill_alike(folder):
    (folder / "bad.csv").write_text("marker,first,last\nRTOE,100,130\nLTOE,200,240\n")
    inside = ("--gaps", folder / "bad.csv", "--no-detect", "--overwrite")
    run("fill", folder / "walk_truth.c3d", *inside, *auto("linear", "spline"))
    take, _ = taken(folder / "walk_truth_filled.c3d.report.json")
    errors = {c["method"]: c["total"]["error"]["rmse_3d"] for c in take["choice"]["candidates"]}
    assert errors["spline"] < errors["linear"]
    assert take["method"] == "spline"


def test_auto_without_anything_to_hide_takes_the_first_that_can_be_used(folder):
    (folder / "bad.csv").write_text("marker,first,last\nLELB,10,470\n")
    options = ("--gaps", folder / "bad.csv", "--no-detect", *auto("llc", "spline", "linear"))
    code, out, _ = run("fill", folder / "walk_truth.c3d", *options)
    assert code == 0
    take, _ = taken(folder / "walk_truth_filled.c3d.report.json")
    assert take["method"] == "spline"
    assert "spline, chosen by auto: the first of those that fill the most, as none of the 1 gaps fits" in out


def test_auto_with_a_limit_of_the_error_asks_for_error_bars(folder):
    code, out, _ = run("fill", folder / "walk.c3d", *auto("linear", "dynammo"), "--max-error", "10.1")
    assert code == 0
    take, _ = taken(folder / "walk_filled.c3d.report.json")
    assert take["method"] == "dynammo"
    assert "linear is left out: it gives no error bars" in out
    tried, kept = take["choice"]["candidates"][1]["total"], take["self_check"]["total"]
    assert tried["error"]["samples"] == tried["samples"] == kept["samples"]
    assert (kept["error"] or {"samples": 0})["samples"] < kept["samples"]


def test_auto_fails_where_no_candidate_can_be_used(folder):
    before = files_in(folder)
    code, _, err = run("fill", folder / "walk.c3d", *auto("llc", "srmmp"))
    assert code == 1
    assert "none of the methods that auto may choose can be used. llc: this method needs a trained dictionary" in err
    assert files_in(folder) == before


# ---- the sidecar


def test_a_sidecar_holds_what_the_file_holds(folder):
    code, out, _ = run("fill", folder / "walk.c3d", *WITH_BARS, "--max-error", "10.1", "--sidecar", folder / "walk.npz")
    assert code == 0
    assert f"arrays in {folder / 'walk.npz'}" in out
    take, _ = taken(folder / "walk_filled.c3d.report.json")
    assert take["sidecar"] == str(folder / "walk.npz")
    got = mocapclean.read(folder / "walk_filled.c3d")
    with np.load(folder / "walk.npz", allow_pickle=False) as arrays:
        status = arrays["status_names"][arrays["status"]]
        assert tuple(arrays["markers"]) == got.markers
        assert np.array_equal(arrays["positions"][got.trusted], got.positions[got.trusted])
        assert str(arrays["method"]) == "dynammo"
        assert np.array_equal(status == "too_uncertain", ~got.trusted)
        for name in ("filled", "too_uncertain"):
            assert (status == name).sum() == take["statuses"][name] > 0
        assert take["statuses"]["too_uncertain"] == take["counts"]["left"]
        assert np.array_equal(np.isfinite(arrays["sd"]), status == "filled")


def test_sidecars_of_several_takes_go_into_a_folder(folder):
    inputs = (folder / "walk.c3d", folder / "walk_01.amc")
    arguments = ("fill", *inputs, "--out-dir", folder / "clean", "--method", "linear", "--no-self-check")
    code, _, err = run(*arguments, "--sidecar", folder / "one.npz")
    assert code == 2
    assert "--sidecar takes a folder for several inputs" in err
    code, _, err = run(*arguments, "--sidecar", folder / "arrays")
    assert (code, err) == (0, "")
    assert {path.name for path in (folder / "arrays").iterdir()} == {"walk.c3d.npz", "walk_01.amc.npz"}
    (folder / "clean" / "walk.c3d").unlink()
    code, _, err = run(*arguments, "--sidecar", folder / "arrays")
    assert code == 2
    assert "exists already" in err
    assert run(*arguments, "--sidecar", folder / "arrays", "--overwrite")[0] == 0


def test_invalidate_marks_what_is_left(folder):
    (folder / "bad.csv").write_text("LELB,20,29\n")
    arguments = ("--gaps", folder / "bad.csv", "--no-detect", "--max-gap", "5", "--invalidate", "--method", "linear")
    code, out, _ = run("fill", folder / "walk_truth.c3d", *arguments, "-o", folder / "out.c3d")
    assert code == 0
    assert "10 samples marked missing" in out
    got = mocapclean.read(folder / "out.c3d")
    assert np.flatnonzero(~got.trusted[:, got.markers.index("LELB")]).tolist() == list(range(19, 29))


def test_a_configuration_file_and_the_resolved_one_in_the_report(folder):
    (folder / "studio.yaml").write_text("method: spline\nmax_gap: 500\nreport: all.json\n")
    code, _, _ = run("fill", folder / "walk.c3d", "--config", folder / "studio.yaml", "--set", "trust.tdd.distance=70")
    assert code == 0
    config = json.loads((folder / "all.json").read_text())["config"]
    assert (config["method"], config["max_gap"], config["trust"]["tdd"]["distance"]) == ("spline", 500, 70.0)


def test_several_inputs_go_one_after_the_other_and_a_failure_stops_none(folder):
    (folder / "broken.c3d").write_bytes(b"\x02\x50" + bytes(100))
    inputs = [folder / name for name in ("walk.c3d", "broken.c3d", "walk.bvh")]
    code, _out, err = run(
        "fill", *inputs, "--out-dir", folder / "clean", "--method", "linear", "--report", folder / "all.json"
    )
    assert code == 1
    assert "broken.c3d" in err
    report = json.loads((folder / "all.json").read_text())
    jsonschema.validate(report, SCHEMA)
    assert [take["status"] for take in report["takes"]] == ["repaired", "failed", "repaired"]
    assert report["totals"]["failed"] == 1
    assert sorted(path.name for path in (folder / "clean").glob("[!.]*")) == ["walk.bvh", "walk.c3d"]


def test_a_skeleton_gives_bones_to_a_c3d(folder):
    code, _, err = run("fill", folder / "walk.c3d", "--skeleton", folder / "walk.asf", "--method", "linear")
    assert code == 2
    assert "the skeleton must share names with the take" in err


def test_inspect_writes_nothing(folder):
    before = files_in(folder)
    code, out, err = run("inspect", folder / "walk.c3d", folder / "walk.bvh", folder / "walk_01.amc")
    assert (code, err) == (0, "")
    assert "markers x" in out
    code, out, _ = run("inspect", folder, "--json")
    rows = [row for line in out.splitlines() for row in json.loads(line)["takes"]]
    assert len(rows) > 3
    take = {"$ref": "#/$defs/take", "$defs": SCHEMA["$defs"]}
    for row in rows:
        jsonschema.validate(row, take)
    assert files_in(folder) == before


def test_quiet_and_verbose(folder):
    assert run("fill", folder / "walk.c3d", "--method", "linear", "-q") == (0, "", "")
    code, out, _ = run("fill", folder / "walk.c3d", "--method", "linear", "--overwrite", "-v")
    assert code == 0
    assert "what became of it" in out


def test_methods_lists_every_method_and_parameter():
    code, out, _ = run("methods")
    assert code == 0
    for name in ("linear", "spline", "trnn2", "second_weight", "doi"):
        assert name in out
    assert run("methods", "magic")[0] == 2


def test_simulate_makes_takes_with_truth_in_every_format(tmp_path):
    code, _, err = run("simulate", "--out-dir", tmp_path / "demo", "--seconds", "2")
    assert (code, err) == (0, "")
    names = {path.name for path in (tmp_path / "demo").iterdir()}
    for motion in ("walk", "boxing"):
        for suffix in (".c3d", "_truth.c3d", ".bvh", "_truth.bvh", ".asf", "_01.amc", "_01_truth.amc"):
            assert f"{motion}{suffix}" in names
    take = mocapclean.read(tmp_path / "demo" / "walk.c3d")
    assert 0 < (~take.trusted).mean() < 0.3


def test_the_installed_command_says_its_version():
    process = launch("--version")
    out, _ = process.communicate(timeout=60)
    assert out == f"mocapclean {mocapclean.__version__}\n"
