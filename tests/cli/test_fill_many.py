"""``mocapclean fill`` over folders, lists and shards: what is written where, and what a second run does."""

import contextlib
import io
import json
import shutil
from pathlib import Path

import jsonschema
import pytest
from click.testing import CliRunner
from small_takes import assert_true, hashes, rows_of, small, store
from test_cli import SCHEMA

from mocapclean.cli import cli
from mocapclean.errors import FormatError
from mocapclean.files import new_file
from mocapclean.pipeline import sidecar

NAMES = ("one.c3d", "day 1/two.c3d", "day 1/three.C3D", "day 2/two.c3d")


def fill(*arguments, stdin=None):
    """Run the command in this process: (exit code, standard output, standard error)."""
    words = ["fill", "--method", "linear", *(str(a) for a in arguments)]
    result = CliRunner().invoke(cli, words, input=stdin)
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture
def captures(tmp_path, monkeypatch):
    """A folder of four takes in the current folder."""
    monkeypatch.chdir(tmp_path)
    return store(Path("captures"), *NAMES)


def test_a_folder_is_mirrored_with_one_row_for_each_take(captures):
    before = hashes(captures)
    (captures / "broken.c3d").write_bytes(small()[:1500])
    code, out, err = fill(captures, "--out-dir", "clean", "--report", "all.json", "--workers", 2)
    assert code == 1
    assert "5 takes: 1 failed, 4 repaired; report in all.json" in out
    assert "captures/broken.c3d" in err
    jsonschema.validate(json.loads(Path("all.json").read_text()), SCHEMA)
    rows = rows_of(Path("all.json"))
    assert list(rows) == [
        f"captures/{name}" for name in ("broken.c3d", "one.c3d", "day 1/three.C3D", "day 1/two.c3d", "day 2/two.c3d")
    ]
    assert_true(rows, Path("clean"))
    assert {name for name in hashes(Path("clean")) if not name.startswith(".")} == set(NAMES)
    assert {name: found for name, found in hashes(captures).items() if name in before} == before


def test_each_take_has_its_own_report_unless_one_is_asked_for(captures):
    code, _, _ = fill(captures, "--out-dir", "clean")
    assert code == 0
    for name in NAMES:
        (row,) = rows_of(Path("clean") / f"{name}.report.json").values()
        assert row["output"] == f"clean/{name}"


def test_the_report_of_many_is_the_report_of_each_in_one(captures):
    fill(captures, "--out-dir", "clean", "--report", "two.json", "--workers", 2)
    shutil.rmtree("clean")
    fill(captures, "--out-dir", "clean", "--report", "one.json")
    one, two = (json.loads(Path(name).read_text()) for name in ("one.json", "two.json"))
    for row in (*one["takes"], *two["takes"]):
        row["seconds"] = 0
    assert one["takes"] == two["takes"]
    assert one["totals"] == two["totals"]


def test_json_is_one_line_for_each_take_and_nothing_else(captures):
    (captures / "broken.c3d").write_bytes(b"1")
    code, out, _ = fill(captures, "--out-dir", "clean", "--json", "--report", "all.json")
    assert code == 1
    lines = [row for line in out.splitlines() for row in json.loads(line)["takes"]]
    assert {line["source"]: line for line in lines} == rows_of(Path("all.json"))


@pytest.mark.parametrize(("separator", "options"), [(b"\n", ()), (b"\r\n", ()), (b"\0", ("-0",))])
def test_a_list_mirrors_the_paths_that_it_names(captures, separator, options):
    names = separator.join(f"captures/{name}".encode() for name in NAMES) + separator
    code, _, _ = fill("--files-from", "-", *options, "--out-dir", "clean", "--no-report", stdin=io.BytesIO(names))
    assert code == 0
    assert {name for name in hashes(Path("clean")) if not name.startswith(".")} == {f"captures/{n}" for n in NAMES}
    arguments = ("--out-dir", "flat", "--relative-to", "captures", "--no-report")
    code, _, _ = fill("--files-from", "-", *options, *arguments, stdin=io.BytesIO(names))
    assert code == 0
    assert {name for name in hashes(Path("flat")) if not name.startswith(".")} == set(NAMES)


def test_sidecars_are_mirrored_too_and_without_one_the_take_has_failed(captures):
    Path("arrays/day 2").mkdir(parents=True)
    code, _, _ = fill(captures, "--out-dir", "clean", "--sidecar", "arrays", "--report", "all.json")
    assert code == 0
    assert set(hashes(Path("arrays"))) == {f"{name}.npz" for name in NAMES}
    shutil.rmtree("arrays/day 2")
    Path("arrays/day 2").symlink_to("nowhere")
    shutil.rmtree("clean")
    code, _, err = fill(captures, "--out-dir", "clean", "--sidecar", "arrays", "--report", "two.json", "--overwrite")
    assert code == 2
    assert "arrays/day 2: the folder cannot be made" in err


def test_a_take_whose_arrays_cannot_be_written_leaves_nothing(captures, monkeypatch):
    def full(*arguments):
        raise FormatError("arrays/one.npz", "cannot be written: No space left on device.")

    monkeypatch.setattr(sidecar, "save", full)
    code, _, err = fill(captures / "one.c3d", "--out-dir", "clean", "--sidecar", "arrays", "--report", "all.json")
    assert code == 1
    assert "No space left" in err
    assert_true(rows_of(Path("all.json")), Path("clean"))


def test_patterns_choose_files(captures):
    arguments = ("--out-dir", "clean", "--no-report", "--include-files", "two*", "--exclude-files", "day 2/*")
    assert fill(captures, *arguments)[0] == 0
    assert {name for name in hashes(Path("clean")) if not name.startswith(".")} == {"day 1/two.c3d"}


def test_shards_together_are_the_whole_run_and_it_can_be_resumed_with_others(captures):
    for index in (1, 2, 3):
        code, _, _ = fill(captures, "--out-dir", "clean", "--shard", f"{index}/3", "--report", f"{index}.json")
        assert code == 0
    rows = [rows_of(Path(f"{index}.json")) for index in (1, 2, 3)]
    assert sum(map(len, rows)) == len(set().union(*rows)) == len(NAMES)
    code, out, _ = fill(captures, "--out-dir", "clean", "--resume", "--report", "all.json")
    assert code == 0
    assert f"{len(NAMES)} done before" in out
    assert rows_of(Path("all.json")) == {source: row for part in rows for source, row in part.items()}


def touched(folder):
    return {str(path): (path.stat().st_ino, path.stat().st_mtime_ns) for path in folder.rglob("*.[cC]3[dD]")}


def test_resume_redoes_what_changed_and_nothing_else(captures):
    arguments = (captures, "--out-dir", "clean", "--report", "all.json")
    assert fill(*arguments)[0] == 0
    first, rows = touched(Path("clean")), rows_of(Path("all.json"))
    code, out, _ = fill(*arguments, "--resume")
    assert (code, touched(Path("clean"))) == (0, first)
    assert "4 done before" in out
    assert rows_of(Path("all.json")) == rows

    (captures / "one.c3d").write_bytes(small(99))
    (Path("clean") / "day 2" / "two.c3d").unlink()
    (captures / "day 1" / "two.c3d").touch()
    assert fill(*arguments, "--resume")[0] == 0
    second = touched(Path("clean"))
    assert {name for name in first if first[name] != second[name]} == {"clean/one.c3d", "clean/day 2/two.c3d"}
    assert_true(rows_of(Path("all.json")), Path("clean"))

    assert fill(*arguments, "--resume", "--max-gap", 3)[0] == 0
    third = touched(Path("clean"))
    assert all(second[name] != third[name] for name in second)
    assert all(row["counts"]["left"] == 6 for row in rows_of(Path("all.json")).values())


def test_resume_removes_half_files_of_what_it_goes_on_with_and_no_others(captures):
    assert fill(captures, "--out-dir", "clean")[0] == 0
    parts = set()
    for name in ("one.c3d", "one.c3d.report.json"):
        with contextlib.suppress(KeyboardInterrupt), new_file(Path("clean") / name) as part:
            parts.add(part.rename(f"{part.parent}/{part.name.replace('.part', 'x.part')}"))
            raise KeyboardInterrupt
    stranger = Path("clean/.one.part.c3d")
    stranger.touch()
    Path("clean/one.c3d").unlink()
    assert fill(captures, "--out-dir", "clean", "--resume")[0] == 0
    assert not any(part.exists() for part in parts)
    assert stranger.exists()


def test_resume_knows_its_outputs_from_any_folder(captures, monkeypatch):
    assert fill(captures, "--out-dir", "clean")[0] == 0
    monkeypatch.chdir("captures")
    code, out, _ = fill(".", "--out-dir", "../clean", "--resume", "--report", "../all.json")
    assert code == 0
    assert "4 done before" in out
    assert_true(rows_of(Path("../all.json")), Path("../clean"))


def test_resume_never_replaces_what_someone_else_has_changed(captures):
    assert fill(captures, "--out-dir", "clean", "--no-report")[0] == 0
    mine = Path("clean/one.c3d")
    mine.write_bytes(b"edited by hand")
    code, _, err = fill(captures, "--out-dir", "clean", "--no-report", "--resume")
    assert code == 1
    assert "clean/one.c3d: the output exists already" in err
    assert mine.read_bytes() == b"edited by hand"
    assert fill(captures, "--out-dir", "clean", "--no-report", "--resume", "--overwrite")[0] == 0
    assert mine.read_bytes() != b"edited by hand"


def test_resume_never_replaces_what_was_not_begun(captures):
    assert fill(captures / "one.c3d", "--out-dir", "clean")[0] == 0
    for name in ("day 1/two.c3d", "day 2/two.c3d.report.json"):
        (Path("clean") / name).parent.mkdir(parents=True)
        (Path("clean") / name).write_bytes(b"somebody's own")
    code, _, err = fill(captures, "--out-dir", "clean", "--resume")
    assert code == 1
    assert err.count("exists already") == 2
    for name in ("day 1/two.c3d", "day 2/two.c3d.report.json"):
        assert (Path("clean") / name).read_bytes() == b"somebody's own"
    assert sorted(name for name in hashes(Path("clean")) if name.lower().endswith(".c3d")) == [
        "day 1/three.C3D",
        "day 1/two.c3d",
        "one.c3d",
    ]


REFUSED = [
    ("a folder without --out-dir", ("captures",), "an input folder needs --out-dir"),
    ("nothing there", ("captures", "--out-dir", "out", "--include-files", "*.bvh"), "at least one take"),
    ("two of one name", ("captures/day 1/two.c3d", "captures/day 2/two.c3d", "--out-dir", "out"), "two results"),
    ("the same tree twice", ("captures", "copy", "--out-dir", "out"), "two results would have this name"),
    ("through a link", ("captures", "--out-dir", "linked"), "the output must stay in linked"),
    ("over an input", ("captures", "--out-dir", "captures", "--overwrite"), "at least one take"),
    ("over another input", ("captures/one.c3d", "a/one.c3d", "--out-dir", "a", "--overwrite"), "two results"),
    ("over a file that is there", ("captures", "--out-dir", "copy"), "exists already"),
    ("the report over an output", ("captures", "--out-dir", "out", "--report", "out/one.c3d"), "two results"),
    ("resume from nowhere", ("captures/one.c3d", "--resume"), "--resume and --shard need --out-dir"),
    ("a bad shard", ("captures", "--out-dir", "out", "--shard", "4/3"), "a shard must be i/n"),
    ("no workers", ("captures", "--out-dir", "out", "--workers", "0"), "workers must be greater than 0"),
    ("no size", ("captures", "--out-dir", "out", "--memory", "much"), "memory must be a number of bytes"),
    ("out of the root", ("captures", "--out-dir", "out", "--relative-to", "copy"), "must lie below"),
    ("a list that is not there", ("--files-from", "none.txt", "--out-dir", "out"), "none.txt"),
]


@pytest.mark.parametrize(("what", "arguments", "message"), REFUSED, ids=[row[0] for row in REFUSED])
def test_what_could_lose_a_file_is_refused_before_anything_is_begun(captures, what, arguments, message):
    shutil.copytree("captures", "copy")
    store(Path("a"), "one.c3d")
    Path("elsewhere").mkdir()
    Path("linked").mkdir()
    Path("linked/day 1").symlink_to("../elsewhere")
    before = hashes(Path())
    code, out, err = fill(*arguments)
    assert (code, out) == (2, "")
    assert message in err
    assert hashes(Path()) == before


def test_control_characters_of_a_file_do_not_reach_the_terminal(captures):
    import c3d_builder

    points = c3d_builder.walk()
    points[10:14, :2, 3] = -1
    evil = "\x1b]0;owned\x07"
    content = c3d_builder.C3D(points, labels=[evil, "<script>", "M3", "M4", "M5"]).build()
    Path("captures/one.c3d").write_bytes(content)
    name = f"captures/{evil.replace('/', '')}\n.c3d"
    Path(name).write_bytes(content[:700])
    _, out, err = fill("captures", "--out-dir", "clean", "--report", "all.json", "-v")
    assert all(c.isprintable() for line in (*out.split("\n"), *err.split("\n")) for c in line)
    assert "\\x1b]0;owned\\x07" in out
    assert rows_of(Path("all.json"))[name]["status"] == "failed"
    _, out, _ = fill("captures", "--out-dir", "other", "--no-report", "--json")
    assert all(c.isprintable() for line in out.split("\n") for c in line)
