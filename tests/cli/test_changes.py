"""What the defaults change in a file, what they leave, and that every change is told."""

import json

import numpy as np
import pytest
from commands import run

import mocapclean
from mocapclean.formats import c3d
from mocapclean.simulate import hide, perform
from mocapclean.take import Finding
from mocapclean.take.status import Status, detected


@pytest.fixture(scope="module")
def walk():
    """Three seconds of walking, complete."""
    return perform("walk", 3.0, 100.0, 3).markers


def fill(folder, *options):
    """Run fill on take.c3d; return the exit code, the text and the take's row of the report."""
    report = folder / "report.json"
    arguments = ("fill", folder / "take.c3d", "-o", folder / "out.c3d", "--report", report, "--overwrite", *options)
    code, text, _ = run(*arguments)
    (row,) = json.loads(report.read_text())["takes"]
    return code, text, row


def test_measured_samples_of_spans_are_told_as_replaced_with_number_and_distance(walk, tmp_path):
    c3d.create(walk, tmp_path / "take.c3d")
    (tmp_path / "bad.csv").write_text("LANK,101,110\nRANK,151,152\n")
    code, text, row = fill(tmp_path, "--gaps", tmp_path / "bad.csv")
    assert code == 0
    before, after = mocapclean.read(tmp_path / "take.c3d"), mocapclean.read(tmp_path / "out.c3d")
    moved = np.linalg.norm(after.positions - before.positions, axis=2)
    assert row["counts"]["replaced"] == 12 == sum(gap["samples_replaced"] for gap in row["gaps"])
    assert row["largest_move"] == pytest.approx(moved.max(), rel=1e-6)
    assert f"12 measured samples of 2 markers, by up to {moved.max():.2f} mm" in text
    gap = next(gap for gap in row["gaps"] if gap["marker"] == "RANK")
    column = before.markers.index("RANK")
    assert gap["largest_move"] == pytest.approx(moved[150:152, column].max(), rel=1e-6)
    assert gap["status"] == "replaced"


def test_a_gap_graded_poor_is_left_unless_asked_for(walk, tmp_path):
    missing = np.zeros_like(walk.trusted)
    missing[100:160, walk.markers.index("LFIN")] = True
    c3d.create(hide(walk, missing), tmp_path / "take.c3d")
    strict = ("--set", "grades.good=0.0001", "--set", "grades.fair=0.0002")
    code, text, row = fill(tmp_path, *strict)
    assert code == 0
    assert row["counts"]["filled"] == 0
    assert row["statuses"]["poor"] == row["counts"]["left"] == 60
    assert row["gaps"][0]["expected_3d"] > 0.0002
    assert "60 the expected error is graded poor" in text
    assert (tmp_path / "out.c3d").read_bytes() == (tmp_path / "take.c3d").read_bytes()
    _, _, row = fill(tmp_path, *strict, "--fill-poor")
    assert row["counts"]["filled"] == 60
    _, _, row = fill(tmp_path, *strict, "--max-error", "1000")
    assert row["counts"]["filled"] == 60


def test_only_missing_is_the_same_as_replace_missing_and_contradicts_others(walk, tmp_path):
    c3d.create(walk, tmp_path / "take.c3d")
    code, _, err = run("fill", tmp_path / "take.c3d", "--only-missing", "--replace", "suspicious")
    assert code == 2
    assert "contradict" in err
    code, _, _ = fill(tmp_path, "--only-missing")
    assert code == 0


def test_a_reference_is_matched_by_the_frame_numbers_of_the_files(walk, tmp_path):
    """The take is the part of the truth from frame 51 on, with its own numbers."""
    c3d.create(walk, tmp_path / "truth.c3d")
    part = walk.crop(50, 250)
    missing = np.zeros_like(part.trusted)
    missing[80:100, 5] = True
    c3d.create(hide(part, missing), tmp_path / "take.c3d")
    assert mocapclean.read(tmp_path / "take.c3d").first_frame == 51
    _, _, row = fill(tmp_path, "--reference", tmp_path / "truth.c3d")
    assert row["accuracy"]["filled"]["samples"] == 20
    assert row["accuracy"]["filled"]["rmse_3d"] < 20
    c3d.create(walk.crop(0, 40), tmp_path / "early.c3d")
    code, _, err = run("fill", tmp_path / "take.c3d", "--reference", tmp_path / "early.c3d", "-o", tmp_path / "x.c3d")
    assert code == 1 or code == 2
    assert "must share frames with the take, 51 to 250. It has 1 to 40" in err


def test_a_suspicion_leaves_its_samples_measured_and_has_a_status_of_its_own(walk):
    finding = Finding(rule="drift", message="", marker=walk.markers[2], frames=(10, 30), suspicion=True)
    take = mocapclean.Take(
        positions=walk.positions, trusted=walk.trusted, markers=walk.markers, rate=walk.rate, findings=(finding,)
    )
    codes = detected(take)
    assert (codes[10:30, 2] == Status.SUSPICIOUS).all()
    assert (codes == Status.SUSPICIOUS).sum() == 20
    assert not take.distrusted_by("drift").any()


def test_a_take_without_a_trusted_sample_does_not_pass(walk, tmp_path):
    c3d.create(hide(walk, np.ones_like(walk.trusted)), tmp_path / "nothing.c3d")
    code, text, _ = run("check", tmp_path / "nothing.c3d")
    assert code == 1
    assert "no sample of the take is trusted" in text


def test_takes_of_three_formats_with_one_name_have_reports_and_arrays_of_their_own(tmp_path):
    assert run("simulate", "--out-dir", tmp_path, "--motion", "walk", "--seconds", "1")[0] == 0
    inputs = (tmp_path / "walk.c3d", tmp_path / "walk.bvh", tmp_path / "walk_01.amc")
    options = (
        "--method",
        "linear",
        "--no-self-check",
        "--out-dir",
        tmp_path / "clean",
        "--sidecar",
        tmp_path / "arrays",
    )
    assert run("fill", *inputs, *options)[0] == 0
    names = {path.name for path in (tmp_path / "clean").iterdir() if not path.name.startswith(".")}
    assert {f"{path.name}.report.json" for path in inputs} <= names
    assert {path.name for path in (tmp_path / "arrays").iterdir()} == {f"{path.name}.npz" for path in inputs}
