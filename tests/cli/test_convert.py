"""``mocapclean convert``, and the other commands on tables."""

import json

import pytest
import table_texts as texts
from click.testing import CliRunner

import mocapclean
from mocapclean.cli import cli
from tests.conftest import SAMPLES


def run(*arguments):
    return CliRunner().invoke(cli, list(map(str, arguments)))


def test_one_take_is_converted_and_its_losses_are_told(tmp_path):
    (tmp_path / "take.tsv").write_bytes(texts.qualisys())
    done = run("convert", tmp_path / "take.tsv", tmp_path / "take.trc")
    assert done.exit_code == 0
    assert "QUALISYS to TRC, 6 markers x 40 frames (1-40) at 100 Hz" in done.stdout
    assert "left out    events: 1" in done.stdout
    again = run("convert", tmp_path / "take.tsv", tmp_path / "take.trc")
    assert again.exit_code == 2
    assert "exists already" in again.stderr


def test_a_folder_is_converted_into_another(tmp_path):
    (tmp_path / "in" / "sub").mkdir(parents=True)
    (tmp_path / "in" / "one.trc").write_bytes(texts.trc())
    (tmp_path / "in" / "sub" / "two.csv").write_bytes(texts.motive())
    (tmp_path / "in" / "notes.csv").write_text("who,when\nAnn,today\n")
    done = run("convert", tmp_path / "in", "--out-dir", tmp_path / "out", "--to", "c3d", "--json")
    assert done.exit_code == 0
    rows = [row for line in done.stdout.splitlines() for row in json.loads(line)["takes"]]
    assert [row["read_as"] for row in rows] == ["trc", "motive"]
    assert mocapclean.read(tmp_path / "out" / "sub" / "two.c3d").trusted.shape == (40, 6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["take.trc"], "give an input and an output"),
        (["take.trc", "--out-dir", "out"], "--out-dir must go with --to"),
        (["take.trc", "--out-dir", "out", "--to", "fbx"], "--out-dir must go with --to"),
        (["take.trc", "take.txt"], "must end in one of"),
        (["take.trc", "take.trc"], "must not be the input"),
        (["take.trc", "out.csv", "--format", "fbx"], "format"),
    ],
)
def test_a_wrong_command_is_refused(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "take.trc").write_bytes(texts.trc())
    done = run("convert", *arguments)
    assert done.exit_code in (1, 2)
    assert message in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["take.trc"]


def test_files_of_a_folder_that_hold_no_take_are_left_out_with_a_remark(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "take.csv").write_bytes(texts.plain())
    (tmp_path / "in" / "gaps.csv").write_text("marker,first,last\nC7,3,4\n")
    done = run(
        *(
            "fill",
            tmp_path / "in",
            "--out-dir",
            tmp_path / "out",
            "--method",
            "linear",
            "--no-self-check",
            "--no-report",
        )
    )
    assert done.exit_code == 0
    assert "hold no take are left out: 1 (gaps.csv)" in done.stderr
    assert (tmp_path / "out" / "take.csv").exists()
    assert not (tmp_path / "out" / "gaps.csv").exists()


@pytest.mark.parametrize("name", ["trc.trc", "motive.csv", "nexus.csv", "qualisys.tsv", "plain_semicolon.csv"])
def test_the_commands_work_on_the_tables_of_all_makers(name, tmp_path):
    path = tmp_path / name
    path.write_bytes(texts.TEXTS[name])
    inspected = run("inspect", path)
    assert inspected.exit_code == 0
    assert "5 samples (2.08 %) in 1 gap" in inspected.stdout
    checked = run("check", path, "--set", "check.longest_gap=4")
    assert checked.exit_code == 1
    out = tmp_path / f"out{path.suffix}"
    report = tmp_path / "report.json"
    done = run("fill", path, "-o", out, "--report", report, "--sidecar", tmp_path / "out.npz", "--method", "linear")
    assert done.exit_code == 0, done.stderr
    assert mocapclean.read(out).trusted.all()
    assert run("report", report, tmp_path, "-o", tmp_path / "page.html").exit_code == 0
    assert json.loads(report.read_text())["takes"][0]["format"] == mocapclean.read(path).origin.format


def test_a_given_format_decides(tmp_path):
    (tmp_path / "take.txt").write_bytes(texts.nexus())
    options = ["--format", "nexus", "--method", "linear", "--no-self-check", "--no-report"]
    done = run("fill", tmp_path / "take.txt", "-o", tmp_path / "out.txt", *options)
    assert done.exit_code == 0, done.stderr
    assert "NEXUS, 6 markers" in done.stdout


def test_a_take_of_markers_can_be_a_reference_of_another_format(tmp_path):
    run("convert", SAMPLES / "walk_truth.c3d", tmp_path / "truth.trc")
    run("convert", SAMPLES / "walk.c3d", tmp_path / "walk.csv")
    options = ["--method", "linear", "--no-self-check", "--no-report"]
    done = run("fill", tmp_path / "walk.csv", "--reference", tmp_path / "truth.trc", *options)
    assert done.exit_code == 0, done.stderr
    assert "error " in done.stdout
