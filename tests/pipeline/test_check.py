"""``check``: every limit is kept by one take and not by another; its files are what CI reads; its recipes work."""

import itertools
import json
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from ruamel.yaml import YAML

from mocapclean.config.loading import resolve
from mocapclean.config.presets import PRESETS
from mocapclean.config.settings import TakeLimits
from mocapclean.formats import c3d
from mocapclean.parameters import annotations
from mocapclean.pipeline.check import CheckTake
from mocapclean.pipeline.outcome import Breach, Verdict
from mocapclean.report.junit import junit
from mocapclean.simulate import hide, inject, perform
from tests import commands

RECIPES = Path(__file__).resolve().parents[2] / "docs" / "check.md"
HOOKS = RECIPES.parents[1] / ".pre-commit-hooks.yaml"


@pytest.fixture(autouse=True)
def _outside_of_github(monkeypatch):
    for name in ("GITHUB_ACTIONS", "GITHUB_STEP_SUMMARY"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture(scope="module")
def takes(tmp_path_factory):
    """A clean take, one with gaps, one with a swap and one in the wrong unit, in two folders."""
    folder = tmp_path_factory.mktemp("captures")
    (folder / "bad").mkdir()
    clean = perform("walk", 2.0, 120.0, 0).markers
    missing = np.zeros_like(clean.trusted)
    missing[50:90, clean.markers.index("LFIN")] = True
    missing[100:110, clean.markers.index("RFIN")] = True
    c3d.create(clean, folder / "clean.c3d")
    c3d.create(hide(clean, missing), folder / "gaps.c3d")
    c3d.create(inject(clean, np.random.default_rng(1), ["swap"]).take, folder / "bad" / "swap.c3d")
    c3d.create(replace(clean, positions=clean.positions / 1000.0), folder / "bad" / "metres.c3d")
    return folder


run = partial(commands.run, "check")


def breached(source, **limits):
    settings = resolve(None, {"check": limits, "method": "linear"})
    return {breach.limit for breach in CheckTake(settings)(source).breaches}


LIMITS = [
    ("gaps", {"longest_gap": 39}, {"longest_gap": 40}, "longest_gap"),
    ("gaps", {"longest_inner_gap": 0.33}, {"longest_inner_gap": 0.34}, "longest_inner_gap"),
    ("gaps", {"preset": "gait-lab"}, {"preset": "game"}, "longest_inner_gap"),
    ("gaps", {"missing": 0.5}, {"missing": 0.6}, "missing"),
    ("bad/swap", {"distrusted": 0}, {"distrusted": 50, "swaps": None}, "distrusted"),
    ("bad/swap", {}, {"swaps": 1}, "swaps"),
    ("bad/metres", {}, {"units": False}, "units"),
    ("clean", {"bone_deviation": 0.1}, {"bone_deviation": 200}, "bone_deviation"),
    ("clean", {"required": ["NOSE"]}, {"required": ["C7", "*HEE"]}, "required"),
    ("clean", {"rates": [100, 60]}, {"rates": [100, 120]}, "rates"),
    ("clean", {"shortest": 3}, {"shortest": 2}, "shortest"),
    ("clean", {"longest": 1}, {"longest": 2}, "longest"),
    ("gaps", {"expected_error": 1e-3}, {"expected_error": 1e3}, "expected_error"),
    ("gaps", {"markers": {"LFIN": {"longest_gap": 39}}}, {"markers": {"LFIN": {"longest_gap": 40}}}, "longest_gap"),
    ("gaps", {"markers": {"*FIN": {"missing": 16}}}, {"markers": {"*FIN": {"missing": 17}}}, "markers.missing"),
    (
        "bad/swap",
        {"markers": {"*": {"distrusted": 0}}},
        {"markers": {"*": {"distrusted": 90}}, "swaps": None},
        "markers.distrusted",
    ),
    ("clean", {"markers": {"NOSE": {"missing": 5}}}, {"markers": {"C7": {"missing": 5}}}, "markers"),
]


@pytest.mark.parametrize(("name", "asked", "allowed", "limit"), LIMITS, ids=[limit for *_, limit in LIMITS])
def test_every_limit_is_kept_or_not(takes, name, asked, allowed, limit):
    source = takes / f"{name}.c3d"
    assert limit in breached(source, **asked)
    assert breached(source, **{"units": name != "bad/metres", **allowed}) == set()


def test_every_limit_has_a_case():
    tried = {key for _, asked, *_ in LIMITS for key in asked} | {"swaps", "units", "replaced"}
    assert tried == set(annotations(TakeLimits))


def test_what_a_fill_would_replace_has_a_limit(takes):
    def share(**options):
        verdict = CheckTake(resolve(None, {"check": {"swaps": None, "replaced": 0.01}, **options}))(
            takes / "bad/swap.c3d"
        )
        return verdict.measures["replaced"], {breach.limit for breach in verdict.breaches}

    assert share() == (0.0, set())
    replaced, limits = share(replace="suspicious")
    assert replaced > 0.01
    assert limits == {"replaced"}


def test_a_markers_own_gap_stands_in_place_of_the_general_one(takes):
    own = {"LFIN": {"longest_gap": 50}}
    assert breached(takes / "gaps.c3d", longest_gap=20, markers=own) == set()
    assert breached(takes / "gaps.c3d", longest_gap=5, markers=own) == {"longest_gap"}


def test_a_folder_is_checked_whole_and_never_touched(takes, tmp_path):
    before = {path: path.read_bytes() for path in takes.rglob("*.c3d")}
    code, out, err = run(takes, "--junit", tmp_path / "check.xml", "--report", tmp_path / "check.json")
    assert (code, err) == (1, "")
    lines = out.splitlines()
    assert [line[:4] for line in lines[:-1]] == ["pass", "pass", "FAIL", "FAIL"]
    assert lines[-1] == "2 of 4 takes pass; the default limits"
    assert {path: path.read_bytes() for path in takes.rglob("*.c3d")} == before
    report = json.loads((tmp_path / "check.json").read_text(encoding="utf-8"))
    assert report["totals"] == {"takes": 4, "passed": 2, "failed": 2}
    limits = {Path(take["source"]).stem: [breach["limit"] for breach in take["breaches"]] for take in report["takes"]}
    assert limits == {"metres": ["units"], "swap": ["swaps"], "clean": [], "gaps": []}
    root = ElementTree.parse(tmp_path / "check.xml").getroot()
    assert [(suite.get("name"), suite.get("tests"), suite.get("failures")) for suite in root] == [
        (str(takes), "2", "0"),
        (str(takes / "bad"), "2", "2"),
    ]
    failures = {case.get("name"): case.find("failure") for case in root.iter("testcase")}
    assert "spans with swapped labels: 1, 0 allowed. To do: exchange them" in failures["swap.c3d"].text
    assert failures["clean.c3d"] is None


def test_quiet_prints_only_what_fails(takes):
    assert run(takes / "clean.c3d", "-q") == (0, "", "")
    code, out, _ = run(takes, "-q")
    assert code == 1
    assert [line[:4] for line in out.splitlines()] == ["FAIL", "FAIL"]


def test_json_is_a_line_for_each_take_and_nothing_else(takes):
    code, out, err = run(takes, "--json")
    assert (code, err) == (1, "")
    rows = [row for line in out.splitlines() for row in json.loads(line)["takes"]]
    assert [row["passes"] for row in rows] == [True, True, False, False]


def test_verbose_says_what_to_do(takes):
    code, out, _ = run(takes / "gaps.c3d", "-v", "--set", "check.longest_gap=5")
    assert code == 1
    assert "LFIN is missing for 40 frames (51-90), 5 allowed; fill it by hand" in out
    assert "RFIN is missing for 10 frames" in out


def test_the_frames_of_the_longest_inner_gap_and_of_the_worst_bone_are_told(takes, tmp_path):
    _, out, _ = run(takes / "gaps.c3d", "--set", "check.longest_inner_gap=0.1")
    assert "the longest inner gap is 0.333 s, of LFIN in frames 51-90, 0.1 s allowed" in out
    take = perform("walk", 2.0, 120.0, 0).markers
    positions = take.positions.copy()
    positions[70, take.markers.index("C7")] += 300.0
    c3d.create(replace(take, positions=positions), tmp_path / "step.c3d")
    _, out, _ = run(tmp_path / "step.c3d", "--no-detect", "--set", "check.bone_deviation=100")
    assert re.search(r"a bone is off its length by \S+ mm, .*\bC7\b.* in frame 71, 100 mm allowed", out)
    _, out, _ = run(tmp_path / "step.c3d", "--no-detect", "--set", "check.bone_deviation=100", "--frames", "60:80")
    assert "in frame 71" in out


@pytest.mark.parametrize("command", ["check", "inspect", "fill"])
def test_markers_that_the_take_lacks_are_refused(takes, command):
    code, out, err = commands.run(command, takes / "clean.c3d", "--markers", "NO*")
    assert code > 0
    assert "--markers must name markers of the take. Got 'NO*'" in out + err


def test_lines_of_the_log_name_their_take(takes):
    _, _, err = run(takes / "gaps.c3d", "-v")
    assert "event=detected" in err
    assert all("gaps.c3d" in line for line in err.splitlines())


def test_a_file_that_cannot_be_read_fails_and_the_others_are_checked(takes, tmp_path):
    (tmp_path / "broken.c3d").write_bytes(b"no capture")
    shutil.copy(takes / "clean.c3d", tmp_path / "fine.c3d")
    code, out, err = run(tmp_path)
    assert (code, err) == (1, "")
    assert out.splitlines()[0].count("broken.c3d") == 1
    assert out.splitlines()[1].startswith("pass")


def test_workers_find_the_same_in_the_same_order(takes, tmp_path):
    reports = []
    for n_workers in (1, 2):
        folder = tmp_path / str(n_workers)
        folder.mkdir()
        run(takes, "--workers", n_workers, "--report", folder / "check.json")
        reports.append(json.loads((folder / "check.json").read_text(encoding="utf-8"))["takes"])
    for take in (*reports[0], *reports[1]):
        assert take.pop("seconds") > 0
    assert reports[0] == reports[1]


def test_presets_are_ordered_from_strict_to_loose():
    names = list(PRESETS)
    for strict, loose in itertools.pairwise(names):
        assert set(PRESETS[strict]) == set(PRESETS[loose])
        assert all(PRESETS[strict][limit] <= PRESETS[loose][limit] for limit in PRESETS[strict])
    assert set(PRESETS[names[0]]) <= set(annotations(TakeLimits))


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_gives_the_limits_that_are_left_open(preset, tmp_path):
    path = tmp_path / "studio.yaml"
    path.write_text(f"check: {{preset: {preset}, missing: 3, bone_deviation: null}}\n", encoding="utf-8")
    check = resolve(path, {}, ["check.swaps=7"]).check
    assert (check.missing, check.bone_deviation, check.swaps) == (3.0, None, 7)
    assert (check.longest_inner_gap, check.replaced) == tuple(
        PRESETS[preset][name] for name in ("longest_inner_gap", "replaced")
    )
    assert resolve(None, {}, [f"check.preset={preset}"]).check.missing == PRESETS[preset]["missing"]


def test_the_documented_presets_are_those_of_the_code():
    rows = re.findall(
        r"^\| `([a-z-]+)` \| ([\d.]+) s \| ([\d.]+) % \| ([\d.]+) % \| (\d+) \| (\d+) mm \|$",
        RECIPES.read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    assert {name: [*map(float, values)] for name, *values in rows} == {
        name: [*map(float, limits.values())] for name, limits in PRESETS.items()
    }


def test_the_preset_is_named_wherever_the_result_is(takes, tmp_path):
    files = {name: tmp_path / f"check.{name}" for name in ("json", "xml", "md")}
    arguments = ("--report", files["json"], "--junit", files["xml"], "--summary", files["md"])
    code, out, _ = run(takes / "clean.c3d", "--preset", "film", "--set", "check.missing=50", *arguments)
    assert code == 0
    assert out.splitlines()[-1] == "1 of 1 takes pass; limits of the preset film but for missing"
    assert json.loads(files["json"].read_text(encoding="utf-8"))["config"]["check"]["preset"] == "film"
    assert "preset film" in ElementTree.parse(files["xml"]).getroot().get("name")
    assert "Limits of the preset film but for missing." in files["md"].read_text(encoding="utf-8")
    assert run(takes / "clean.c3d", "--preset", "radio")[0] == 2


def test_github_is_told_where_it_asks(takes, tmp_path, monkeypatch):
    swap, step = takes / "bad" / "swap.c3d", tmp_path / "step.md"
    step.write_text("before\n", encoding="utf-8")
    _, _, err = run(swap)
    assert err == ""
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(step))
    code, _, err = run(takes)
    assert code == 1
    assert [line.split(",")[0] for line in err.splitlines()] == [
        f"::error file={takes / 'bad' / name}" for name in ("metres.c3d", "swap.c3d")
    ]
    text = step.read_text(encoding="utf-8")
    assert text.startswith("before\n## mocapclean check: 2 of 4 takes pass\n\nThe default limits.\n")
    assert run(swap, "--annotations", "none")[2] == ""
    other = tmp_path / "other.md"
    run(swap, "--summary", other)
    assert step.read_text(encoding="utf-8").count("## ") == 2
    code, _, err = run(swap, "--summary", other)
    assert code == 2
    assert "--overwrite" in err
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "none" / "step.md"))
    code, _, err = run(swap)
    assert code == 2
    assert "GITHUB_STEP_SUMMARY cannot be written" in err


def test_a_take_that_needs_too_long_fails(takes):
    code, out, err = run(takes / "clean.c3d", "--timeout", 0.01, "-v")
    assert (code, err) == (1, "")
    assert "it took longer than the limit of 0.01 s (--timeout)" in out


def test_an_interrupted_check_writes_no_file(takes, tmp_path, monkeypatch):
    def interrupt(found, *, verbose):
        if "clean" in found.source.name:
            signal.raise_signal(signal.SIGINT)
        return "told"

    monkeypatch.setattr("mocapclean.cli.actions.check.verdict", interrupt)
    code, out, err = run(takes, "--workers", "1", "--junit", tmp_path / "check.xml")
    assert code == 130
    assert "takes pass" not in out
    assert re.search("Interrupted after [12] of 4 takes. No file was written", err)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "nowhere: the file or folder must exist"),
        (["{empty}"], "the folders must hold at least one take"),
        (["{take}", "--junit", "{take}"], "must not be"),
        (["{take}", "--set", "check.longest_gap=-1"], "check.longest_gap must be"),
        (["{take}", "--set", "check.longest_gab=1"], "Did you mean 'longest_gap'"),
        (["{take}", "--junit", "{empty}/x", "--report", "{empty}/x"], "must be different files"),
    ],
)
def test_wrong_usage_is_told_and_nothing_is_written(takes, tmp_path, arguments, message):
    empty = tmp_path / "empty"
    empty.mkdir()
    filled = [argument.format(empty=empty, take=takes / "clean.c3d") for argument in arguments]
    code, out, err = run(*filled)
    assert (code, out) == (2, "")
    assert message in err
    assert not list(empty.iterdir())


def test_junit_holds_what_xml_cannot(tmp_path):
    breach = Breach(limit="readable", message="a \x00 byte & a <tag> é \ud800", advice="none")
    root = ElementTree.fromstring(junit([Verdict(source=tmp_path / "a\x0b.c3d", breaches=(breach,))]))
    assert root.find(".//failure").get("message") == "a ? byte & a <tag> é ?. To do: none."


def recipe(name):
    (block,) = re.findall(rf"<!-- {name} -->\n```\w+\n(.*?)```", RECIPES.read_text(encoding="utf-8"), re.DOTALL)
    return block


@pytest.fixture
def shop(takes, tmp_path, monkeypatch):
    """A folder as the recipes take it: captures, studio.yaml with a quick method, and the command on the path."""
    shutil.copytree(takes, tmp_path / "captures")
    (limits,) = re.findall(r"## Limits.*?```yaml\n(.*?)```", RECIPES.read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "studio.yaml").write_text(f"method: linear\n{limits}", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=":")
    return tmp_path


def test_the_documented_limits_are_all_of_them(shop):
    path = shop / "studio.yaml"
    resolve(path, {})
    assert set(YAML(typ="safe").load(path)["check"]) == set(annotations(TakeLimits))


@pytest.mark.parametrize("name", ["github", "gitlab"])
def test_the_commands_of_ci_run(shop, name):
    steps = YAML(typ="safe", pure=True).load(recipe(name))
    script = [step["run"] for step in steps["jobs"]["check"]["steps"] if "run" in step] if name == "github" else None
    commands = [line for line in script or steps["takes"]["script"] if line.startswith("mocapclean")]
    assert len(commands) == 1
    done = subprocess.run(commands[0], shell=True, cwd=shop, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1, done.stderr
    ElementTree.parse(shop / "check.xml")


def test_the_pre_commit_hook_takes_files(shop):
    (declared,) = YAML(typ="safe", pure=True).load(HOOKS.read_text(encoding="utf-8"))
    (repo,) = YAML(typ="safe", pure=True).load(recipe("pre-commit"))["repos"]
    (used,) = repo["hooks"]
    assert used["id"] == declared["id"]
    for name in ("captures/clean.c3d", "walk.BVH", "05_13.amc"):
        assert re.search(declared["files"], name)
    assert not re.search(declared["files"], "05.asf")
    command = [*declared["entry"].split(), *used["args"]]
    done = subprocess.run([*command, "captures/clean.c3d"], cwd=shop, capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (0, b"")
    failing = subprocess.run(
        [*command, "captures/bad/swap.c3d"], cwd=shop, capture_output=True, timeout=60, check=False
    )
    assert failing.returncode == 1
    assert failing.stdout.startswith(b"FAIL")


def test_pre_commit_understands_the_hook():
    clientlib = pytest.importorskip("pre_commit.clientlib", reason="pre-commit is not installed")
    (hook,) = clientlib.load_manifest(str(HOOKS))
    assert hook["language"] == "python"


def test_the_shell_loop_puts_aside_what_fails(shop):
    for bad in (shop / "captures" / "bad").iterdir():
        shutil.move(bad, shop / "captures")
    subprocess.run(["sh", "-c", recipe("shell")], cwd=shop, capture_output=True, timeout=120, check=False)
    assert sorted(path.name for path in (shop / "rejected").iterdir()) == ["metres.c3d", "swap.c3d"]


@pytest.mark.skipif(shutil.which("jq") is None, reason="jq is not installed")
def test_the_jq_lines_answer(shop):
    run("captures", "--report", "check.json")
    for line in recipe("jq").splitlines():
        done = subprocess.run(["sh", "-c", line], cwd=shop, capture_output=True, text=True, timeout=30)
        assert done.returncode == 0, done.stderr
        assert done.stdout.strip()
