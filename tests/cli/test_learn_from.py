"""``mocapclean fill --learn-from``: which files teach a take, which are refused, and what the report states."""

import hashlib
import json
from pathlib import Path

import c3d_builder
import jsonschema
import numpy as np
import pytest
from commands import run
from small_takes import SCHEMA

import mocapclean
from mocapclean.report.page.words import methods_paragraph

NAMES = ("HEAD", "NECK", "HIP", "KNEE", "TOE", "HEEL", "HAND", "ELB")


def trial(seed, *, size=1.0, names=NAMES, rate=120.0, n_frames=200, missing=True):
    """The bytes of a C3D with two rigid segments on a hinge; two markers are missing together for 40 frames."""
    rng = np.random.default_rng(5)
    local = np.round(rng.normal(size=(2, 4, 3)) * 90 * size, 3)
    t = (np.arange(n_frames) + 700 * seed) / rate
    angles = 0.4 * np.sin(0.6 * t), 1.1 * np.sin(2.1 * t) + 0.3 * np.sin(0.9 * t)
    place = np.stack([300 * np.sin(0.4 * t), 200 * t % 900, 900 + 20 * np.sin(3 * t)], axis=1)
    points = np.full((n_frames, 8, 4), 3.0)
    for segment, angle in enumerate(angles):
        cos, sin, (x, y, z) = np.cos(angle)[:, None], np.sin(angle)[:, None], local[segment].T
        own = slice(4 * segment, 4 * segment + 4)
        points[:, own, 0] = place[:, :1] + cos * x - sin * y
        points[:, own, 1] = place[:, 1:2] + sin * x + cos * y
        points[:, own, 2] = place[:, 2:] + z
    points[:, :, :3] += 0.05 * np.random.default_rng(seed).normal(size=(n_frames, 8, 3))
    if missing:
        points[80:120, 4:6, 3] = -1.0
    return c3d_builder.C3D(points, labels=names, units="mm", rate=rate).build()


def points_of(seed):
    """The points (F, 8, 4) of a trial without a gap, as a reader returns them."""
    Path("whole.c3d").write_bytes(trial(seed, missing=False))
    positions = mocapclean.read("whole.c3d").positions
    return np.concatenate([positions, np.full((*positions.shape[:2], 1), 3.0)], axis=2)


@pytest.fixture
def takes(tmp_path, monkeypatch):
    """A folder of three trials of one subject, in the current folder."""
    monkeypatch.chdir(tmp_path)
    folder = Path("trials")
    folder.mkdir()
    for seed, name in enumerate(("one", "two", "three")):
        (folder / f"{name}.c3d").write_bytes(trial(seed))
    return folder


def row(report):
    """The row of the only take of a valid report."""
    content = json.loads(Path(report).read_text(encoding="utf-8"))
    jsonschema.validate(content, SCHEMA)
    (take,) = content["takes"]
    return take


def filled(source, output, *options):
    code, out, err = run("fill", source, "-o", output, *options)
    assert (code, err) == (0, "")
    return out, row(f"{output}.report.json")


def refused(*options):
    """The error of a refused fill of the first trial, which writes nothing."""
    code, _, err = run("fill", "trials/one.c3d", "-o", "out.c3d", *options)
    assert code == 2
    assert not Path("out.c3d").exists()
    return err


def test_a_take_that_learns_from_itself_alone_is_filled_to_the_same_bytes(takes):
    filled(takes / "one.c3d", "plain.c3d")
    Path("copy.c3d").write_bytes((takes / "one.c3d").read_bytes())
    for teacher in (takes / "one.c3d", "copy.c3d", "plain.c3d"):
        output = f"from_{Path(teacher).name}"
        _, taught = filled(takes / "one.c3d", output, "--learn-from", teacher)
        assert taught["learnt_from"] == []
        assert Path(output).read_bytes() == Path("plain.c3d").read_bytes()


def test_the_report_names_the_files_with_their_hashes(takes):
    out, taught = filled(takes / "one.c3d", "out.c3d", "--learn-from", takes)
    assert [each["source"] for each in taught["learnt_from"]] == ["trials/three.c3d", "trials/two.c3d"]
    text = " ".join(out.split())
    for each in taught["learnt_from"]:
        assert each["sha256"] == hashlib.sha256(Path(each["source"]).read_bytes()).hexdigest()
        assert f"{each['source']} (SHA-256 {each['sha256']})" in text
        assert f"{each['source']} (SHA-256 {each['sha256']})" in methods_paragraph(taught)


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_a_folder_teaches_itself_to_the_same_bytes_with_any_number_of_workers(takes, workers):
    for name in ("one", "two", "three"):
        filled(takes / f"{name}.c3d", f"{name}.c3d", "--learn-from", takes)
    code, _, err = run("fill", takes, "--learn-from", takes, "--out-dir", "clean", "--workers", workers)
    assert (code, err) == (0, "")
    for name in ("one", "two", "three"):
        assert Path("clean", f"{name}.c3d").read_bytes() == Path(f"{name}.c3d").read_bytes()


def test_the_configuration_names_files_beside_it(takes):
    Path("studio.yaml").write_text("learn_from: [trials/two.c3d, trials/three.c3d]\n")
    _, one = filled(takes / "one.c3d", "a.c3d", "--config", "studio.yaml")
    options = "--learn-from", takes / "two.c3d", "--learn-from", takes / "three.c3d"
    _, other = filled(takes / "one.c3d", "b.c3d", *options)
    assert [each["sha256"] for each in one["learnt_from"]] == [each["sha256"] for each in other["learnt_from"]]
    assert Path("a.c3d").read_bytes() == Path("b.c3d").read_bytes()


def test_the_subject_in_a_name_does_not_count(takes):
    Path("other.c3d").write_bytes(trial(1, names=tuple(f"Anna:{name}" for name in NAMES)))
    filled(takes / "one.c3d", "a.c3d", "--learn-from", "other.c3d")
    filled(takes / "one.c3d", "b.c3d", "--learn-from", takes / "two.c3d")
    assert Path("a.c3d").read_bytes() == Path("b.c3d").read_bytes()


def test_the_order_of_the_markers_does_not_count(takes):
    points, order = points_of(1), [5, 3, 7, 1, 0, 2, 6, 4]
    for name, columns in (("same.c3d", range(8)), ("other.c3d", order)):
        file = c3d_builder.C3D(points[:, columns], labels=[NAMES[k] for k in columns], units="mm", rate=120.0)
        Path(name).write_bytes(file.build())
        filled(takes / "one.c3d", f"from_{name}", "--learn-from", name)
    assert Path("from_same.c3d").read_bytes() == Path("from_other.c3d").read_bytes()


def test_every_second_frame_of_twice_the_rate_is_learnt_from(takes):
    Path("fast.c3d").write_bytes(trial(2, rate=240.0, n_frames=400))
    _, taught = filled(takes / "one.c3d", "out.c3d", "--learn-from", "fast.c3d")
    assert [each["source"] for each in taught["learnt_from"]] == ["fast.c3d"]


def test_other_markers_sizes_and_rates_are_refused_with_a_list(takes):
    Path("lacking.c3d").write_bytes(trial(1, names=("HEAD", "NECK", "HIP", "KNEE", "BALL", "HEEL", "PALM", "ELB")))
    Path("larger.c3d").write_bytes(trial(2, size=1.2))
    Path("slow.c3d").write_bytes(trial(2, rate=100.0))
    names = "lacking.c3d", "larger.c3d", "slow.c3d", takes / "two.c3d"
    error = refused(*(word for name in names for word in ("--learn-from", name)))
    assert error.startswith("mocapclean: trials/one.c3d: takes to learn from must have the same")
    assert "lacking.c3d lacks TOE, HAND;" in error
    assert "larger.c3d has other distances between markers: " in error
    assert "slow.c3d has 100 Hz for 120 Hz" in error
    assert "two.c3d" not in error
    assert len(error.splitlines()) == 1


def test_a_marker_that_was_placed_anew_does_not_teach(takes):
    points = points_of(2)
    points[:, 7, 2] += 60.0
    Path("moved.c3d").write_bytes(c3d_builder.C3D(points, labels=NAMES, units="mm", rate=120.0).build())
    out, taught = filled(takes / "one.c3d", "out.c3d", "--learn-from", "moved.c3d")
    (learnt,) = taught["learnt_from"]
    assert learnt["moved_markers"] == ["ELB"]
    assert "but for ELB, placed elsewhere there" in " ".join(out.split())


def test_joints_and_methods_that_do_not_learn_are_refused(takes):
    assert run("simulate", "--out-dir", "demo", "--seconds", 1, "--motion", "walk")[0] == 0
    skeleton = next(Path("demo").glob("*.bvh"))
    assert "takes of markers" in refused("--learn-from", skeleton)
    code, _, err = run("fill", skeleton, "-o", "out.bvh", "--learn-from", takes)
    assert (code, Path("out.bvh").exists()) == (2, False)
    assert "takes of markers" in err
    assert "kriging, pca, pma" in refused("--learn-from", takes, "--method", "spline")


def test_a_missing_or_an_empty_place_is_refused(takes):
    Path("empty").mkdir()
    assert "at least one take" in refused("--learn-from", "empty")
    code, _, err = run("fill", "trials/one.c3d", "-o", "out.c3d", "--learn-from", "nowhere.c3d")
    assert code in (1, 2)
    assert "nowhere.c3d" in err


def test_a_resumed_run_repeats_takes_whose_teachers_have_changed(takes):
    Path("teacher.c3d").write_bytes(trial(5))
    words = "fill", takes, "--learn-from", "teacher.c3d", "--out-dir", "clean", "--resume", "--workers", 1
    assert run(*words)[0] == 0
    assert "3 done before" in run(*words)[1]
    before = Path("clean/one.c3d").read_bytes()
    Path("teacher.c3d").write_bytes(trial(9))
    code, out, _ = run(*words)
    assert code == 0
    assert "done before" not in out
    assert Path("clean/one.c3d").read_bytes() != before
