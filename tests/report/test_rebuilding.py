"""The view of a take from its report is that of its run."""

import json
from pathlib import Path

import numpy as np
import pytest
from commands import run
from conftest import SAMPLES

from mocapclean.config.loading import resolve
from mocapclean.errors import MocapcleanError
from mocapclean.pipeline.rebuilding import rebuilt_view
from mocapclean.pipeline.repair import repair
from mocapclean.report import record
from mocapclean.take.status import Status


@pytest.fixture(params=["walk.c3d", "walk.bvh", "walk_01.amc"])
def repaired(request, tmp_path):
    """A sample take with a distrusted span, repaired with its view."""
    source = SAMPLES / request.param
    name = {"walk.c3d": "LFHD", "walk.bvh": "Spine1", "walk_01.amc": "lradius"}[request.param]
    (tmp_path / "bad.csv").write_text(f"marker,first,last\n{name},200,207\n")
    options = {"method": "spline", "self_check": False, "gaps": str(tmp_path / "bad.csv"), "exclude": ["RBAC"]}
    if request.param != "walk.c3d":
        del options["exclude"]
    settings = resolve(None, options)
    views = []
    outcome = repair(source, tmp_path / source.name, settings, tmp_path / "take.npz", views.append)
    assert outcome.status == "repaired", outcome.error
    return record.row(outcome), settings.as_json(), views[0], tmp_path


@pytest.mark.parametrize("with_sidecar", [True, False])
def test_the_view_is_that_of_the_run(repaired, with_sidecar):
    row, config, view, folder = repaired
    sidecar = folder / "take.npz" if with_sidecar else None
    found = rebuilt_view(row, config, Path(row["source"]), Path(row["output"]), sidecar)
    assert np.array_equal(found.codes, view.codes)
    assert {Status.FILLED, Status.REPLACED} <= set(np.unique(found.codes))
    assert np.array_equal(found.in_file, view.in_file)
    assert np.array_equal(found.in_output, view.in_output)
    known = view.in_output
    # A file of text holds its numbers to some digits.
    assert np.abs(found.after.positions - view.after.positions)[known].max() < 0.01
    assert found.neighbours() == view.neighbours()
    assert (found.poses is None) == (view.poses is None)


def test_another_file_is_refused(repaired):
    row, config, _, _ = repaired
    other = SAMPLES / "walk_truth.c3d" if row["format"] != "c3d" else SAMPLES / "walk_truth.bvh"
    with pytest.raises(MocapcleanError):
        rebuilt_view(row, config, other, Path(row["output"]), None)


def test_the_command_says_what_it_does_not_find(tmp_path):
    pytest.importorskip("bokeh", reason="bokeh is not installed (extra html)")
    code, _, _ = run("fill", SAMPLES / "walk.bvh", "-o", tmp_path / "a.bvh", "--method", "linear")
    assert code == 0
    report = tmp_path / "a.bvh.report.json"
    content = json.loads(report.read_text())
    content["takes"][0]["source"] = "nowhere/walk.bvh"
    report.write_text(json.dumps(content))
    code, _, error = run("report", report, "-o", tmp_path / "page.html")
    assert code == 0
    assert "nowhere/walk.bvh: not found" in error
    code, _, error = run("report", report, SAMPLES, "-o", tmp_path / "page.html", "--overwrite")
    assert (code, error) == (0, "")
    code, _, error = run("report", report, "-o", tmp_path / "page.html")
    assert code == 2
    report.write_text("{}")
    code, _, error = run("report", report, "-o", tmp_path / "other.html")
    assert code == 2
    assert "a report must be JSON" in error


def test_a_page_is_written_over_no_take(tmp_path):
    pytest.importorskip("bokeh", reason="bokeh is not installed (extra html)")
    source, output, other = (tmp_path / name for name in ("walk.bvh", "filled.bvh", "elsewhere/other.bvh"))
    other.parent.mkdir()
    for path in (source, other):
        path.write_bytes((SAMPLES / "walk.bvh").read_bytes())
    options = ("--method", "linear", "--sidecar", tmp_path / "arrays.npz")
    assert run("fill", source, "-o", output, *options)[0] == 0
    report = tmp_path / "filled.bvh.report.json"
    for victim in (source, output, other, tmp_path / "arrays.npz", report):
        before = victim.read_bytes()
        code, _, error = run("report", report, other.parent, "-o", victim, "--overwrite")
        assert code == 2
        assert "must not be the input" in error
        assert victim.read_bytes() == before
