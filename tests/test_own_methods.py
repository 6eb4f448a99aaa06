"""Methods and rules of another package: the example of the documentation, installed, and packages that are broken."""

import importlib
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from small_takes import store

import mocapclean
from mocapclean.cli import cli
from mocapclean.config.loading import resolve
from mocapclean.detection import RULES
from mocapclean.errors import ConfigError, PackageError, UsageError
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.contract import LAWS
from tests.conftest import SAMPLES

PAGE = Path(__file__).resolve().parents[1] / "docs" / "own_methods.md"
BROKEN_METHODS = {
    "absent": ("no_such_module", "", "cannot be loaded: ModuleNotFoundError"),
    "faulty": ("faulty_module", "1 / 0", "cannot be loaded: ZeroDivisionError"),
    "partial": ("partial_module", "REFERENCE = 'A paper.'", "TRAITS, Params, solve is missing"),
    "leaving": ("leaving_module", "raise SystemExit(4)", "cannot be loaded: SystemExit: 4"),
    "bare": (
        "bare_module",
        "REFERENCE, TRAITS, Params, solve = 'A paper.', None, dict, print",
        "cannot be used: TRAITS must be of the type Traits",
    ),
    "undeclared": (
        "undeclared_module",
        "from mocapclean.solvers.method import Traits\n"
        "REFERENCE, TRAITS, Params, solve = 'A paper.', Traits(), dict, print",
        "cannot be used: Params must be a class with the decorator parameters",
    ),
    "demanding": (
        "demanding_module",
        "from mocapclean.parameters import parameters\nfrom mocapclean.solvers.method import Traits\n"
        "REFERENCE, TRAITS, solve = 'A paper.', Traits(), print\n"
        "@parameters\nclass Params:\n    share: float\n",
        "cannot be used: Params must have a default for share",
    ),
}


def example():
    """The files of the example by name, as the page has them."""
    text = PAGE.read_text(encoding="utf-8")
    return dict(re.findall(r"^`([\w.]+)`[^\n]*:\n\n```\w+\n(.*?)```", text, re.DOTALL | re.MULTILINE))


def install(folder, name, version, files, points):
    """Put a package into a folder as an installer does: its modules, and its metadata with entry points."""
    folder.mkdir(exist_ok=True)
    for file, text in files.items():
        (folder / file).write_text(text, encoding="utf-8")
    info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n", encoding="utf-8")
    lines = [line for group, of in points.items() for line in (f"[{group}]", *(f"{k} = {v}" for k, v in of.items()))]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder of packages that Python finds."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    for registry in (SOLVERS, RULES):
        monkeypatch.setattr(registry, "_foreign", {})
    before = {*sys.modules}
    yield folder
    for name in {*sys.modules} - before:
        if getattr(sys.modules[name], "__file__", None) and str(folder) in sys.modules[name].__file__:
            del sys.modules[name]
    importlib.invalidate_caches()


@pytest.fixture
def installed(site):
    files = example()
    project = tomllib.loads(files.pop("pyproject.toml"))["project"]
    install(site, project["name"], project["version"], files, project["entry-points"])
    return site


def run(*arguments):
    return CliRunner().invoke(cli, list(map(str, arguments)))


def test_the_example_is_listed_and_keeps_every_law(installed):
    listed = run("methods")
    assert listed.exit_code == 0
    assert "travel (my-mocap-methods 1.0)" in listed.stdout
    checked = run("methods", "--check", "travel")
    assert checked.exit_code == 0, checked.stdout
    assert f"{len(LAWS)} of {len(LAWS)} laws kept; 0 broken" in checked.stdout


def test_the_example_fills_in_python_and_by_the_command_alike(installed, tmp_path):
    out = tmp_path / "walk.c3d"
    done = run("fill", SAMPLES / "walk.c3d", "-o", out, "--method", "travel", "--set", "share=0.5", "--max-error", "90")
    assert done.exit_code == 2  # it has no error bars
    done = run("fill", SAMPLES / "walk.c3d", "-o", out, "--method", "travel", "--set", "share=0.5", "--json")
    assert done.exit_code == 0, done.stderr
    take = mocapclean.detect(mocapclean.read(SAMPLES / "walk.c3d"))
    result = mocapclean.fill(take, "travel", share=0.5)
    assert result.self_check.total.error.samples > 0
    written = mocapclean.write(result.take, tmp_path / "python.c3d")
    assert (tmp_path / "python.c3d").read_bytes() == out.read_bytes()
    assert np.array_equal(written.positions[take.trusted], take.positions[take.trusted])
    with pytest.raises(UsageError, match="share"):
        mocapclean.fill(take, "travel", share=2.0)


def test_the_example_is_compared_with_others(installed, tmp_path):
    small = tmp_path / "small.c3d"
    mocapclean.write(mocapclean.read(SAMPLES / "walk.c3d").crop(0, 120), small)
    done = run(
        "bench", "compare", small, "--quick", "--methods", "travel,linear", "--out-dir", tmp_path / "b", "--no-plots"
    )
    assert done.exit_code == 0, done.stderr
    assert re.search(r"travel +\d", done.stdout)


def test_worker_processes_find_the_example(installed, tmp_path):
    folder = store(tmp_path / "takes", "one.c3d", "two.c3d")
    paths = os.pathsep.join([str(installed), *sys.path])
    command = [
        sys.executable,
        "-m",
        "mocapclean",
        "fill",
        folder,
        "--out-dir",
        tmp_path / "out",
    ]
    command += ["--method", "travel", "--no-self-check", "--no-detect", "--workers", "2", "-q"]
    environment = {**os.environ, "PYTHONPATH": paths}
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert len([*(tmp_path / "out").glob("*.c3d")]) >= 2


def test_a_rule_of_another_package_runs_where_it_is_named(installed):
    take = mocapclean.read(SAMPLES / "walk.c3d")
    lowest = take.positions[take.trusted][:, 2].min()
    assert "floor" not in {finding.rule for finding in mocapclean.detect(take).findings}
    assert "floor" not in resolve(None, {}).rules
    settings = resolve(None, {}, ["trust.floor.enabled=true", f"trust.floor.depth={max(0.0, -lowest - 5)}"])
    assert settings.rules["floor"].depth >= 0.0
    assert settings.as_json()["trust"]["floor"]["enabled"] is True
    deep = take.positions - [0.0, 0.0, lowest + 60.0]
    sunk = mocapclean.Take(positions=deep, trusted=take.trusted, markers=take.markers, rate=take.rate)
    found = mocapclean.detect(sunk, also=["floor"])
    told = [finding for finding in found.findings if finding.rule == "floor"]
    assert told
    assert all(finding.suspicion for finding in told)
    with pytest.raises(ConfigError, match="depth"):
        resolve(None, {}, ["trust.floor.depth=-1.0"])


def test_another_version_of_a_package_is_another_repair(installed):
    own = resolve(None, {"method": "travel"}).identity
    assert own["packages"] == ["my-mocap-methods 1.0"]
    assert "packages" not in resolve(None, {}).identity


@pytest.mark.parametrize("name", BROKEN_METHODS)
def test_a_broken_package_gets_one_sentence(site, tmp_path, name):
    module, text, message = BROKEN_METHODS[name]
    files = {f"{module}.py": text} if text else {}
    install(site, "bad-methods", "0.3", files, {"mocapclean.methods": {name: module}})
    for arguments in (
        ["methods", "--check", name],
        ["fill", SAMPLES / "walk.c3d", "-o", tmp_path / "o.c3d", "--method", name],
    ):
        done = run(*arguments)
        assert done.exit_code == 1
        (line,) = done.stderr.splitlines()
        assert f"{name} of bad-methods 0.3" in line
        assert message in line
    listed = run("methods")
    assert listed.exit_code == 1
    assert "kriging (default)" in listed.stdout
    assert message in listed.stderr


BAD_SOLVE = {
    "raises": ("raise IndexError('no such marker')", "failed: IndexError: no such marker"),
    "bends": (
        "return Solution(positions=take.positions[:1], filled=fillable)",
        "failed: ValueError: positions must have",
    ),
    "moves": (
        "return Solution(positions=take.positions + 1, filled=fillable, moved=take.trusted)",
        "failed: ValueError: moved must be None unless the parameter denoise asks for it",
    ),
    "forgets": ("return None", "failed: ValueError: solve must return a Solution, got NoneType"),
    "leaves": ("exit(3)", "failed: SystemExit: 3"),
    "lists": (
        "return Solution(positions=take.positions, filled=fillable.tolist())",
        "failed: ValueError: filled must be an array of bool",
    ),
    "loses": (
        "return Solution(positions=take.positions * float('nan'), filled=fillable)",
        "failed: ValueError: positions must be finite where filled",
    ),
    "doubts": (
        "return Solution(positions=take.positions, filled=fillable, sd=take.positions[..., 0] * 0 - 1)",
        "failed: ValueError: sd must not be negative where filled",
    ),
}


@pytest.mark.parametrize("name", BAD_SOLVE)
def test_a_method_that_fails_is_named_with_its_package(site, tmp_path, name):
    body, message = BAD_SOLVE[name]
    text = example()["my_travel.py"]
    start = text.index("    origin = ")
    files = {f"{name}_module.py": text[:start] + f"    {body}\n"}
    install(site, "bad-methods", "0.3", files, {"mocapclean.methods": {name: f"{name}_module"}})
    take = store(tmp_path / "takes", "one.c3d") / "one.c3d"
    done = run("fill", take, "-o", tmp_path / "o.c3d", "--method", name, "-q", "--no-detect")
    assert done.exit_code == 1
    assert f"{name} of bad-methods 0.3 {message}" in done.stderr
    assert not (tmp_path / "o.c3d").exists()


def test_the_check_of_a_method_that_breaks_laws_exits_with_1(site):
    text = example()["my_travel.py"].replace("positions=linear", "reason='', positions=linear")
    install(site, "bad-methods", "0.3", {"quiet_module.py": text}, {"mocapclean.methods": {"quiet": "quiet_module"}})
    checked = run("methods", "--check", "quiet")
    assert checked.exit_code == 1
    assert re.search(r"BROKEN +shapes .*\n +reason must tell how the method ended", checked.stdout)


def test_two_packages_with_one_name_are_refused_and_own_names_stay(site):
    for package in ("one", "two"):
        install(site, package, "1", {}, {"mocapclean.methods": {"same": "json", "linear": "json"}})
    with pytest.raises(PackageError, match=r"must be of one package.* one 1 and two 1"):
        SOLVERS["same"]
    assert SOLVERS["linear"].__name__ == "mocapclean.solvers.linear"
    assert "linear" not in SOLVERS.installed()


def test_a_name_that_no_package_has_is_a_key_error_in_one_sentence():
    assert "travel" not in SOLVERS
    with pytest.raises(KeyError) as unknown:
        SOLVERS["travel"]
    assert str(unknown.value) == "mocapclean.methods: no installed package has 'travel'."
    assert SOLVERS.get("travel") is None


def test_a_rule_that_fails_is_named(site):
    files = {"bad_rule.py": example()["my_floor.py"].replace("    take = evidence.take\n", "    raise KeyError('x')\n")}
    install(site, "bad-rules", "2", files, {"mocapclean.rules": {"bad": "bad_rule"}})
    with pytest.raises(PackageError, match="bad of bad-rules 2 failed: KeyError"):
        mocapclean.detect(mocapclean.read(SAMPLES / "walk.c3d").crop(0, 60), also=["bad"])
    with pytest.raises(UsageError, match=r"one of .*bad\. Got 'worse'"):
        mocapclean.detect(mocapclean.read(SAMPLES / "walk.c3d").crop(0, 60), also=["worse"])


@pytest.mark.parametrize(
    ("result", "message"),
    [
        ("evidence.take.trusted[1:], ()", "bool samples of the shape"),
        ("evidence.take.trusted * 1.0, ()", "bool samples of the shape"),
        ("~evidence.take.trusted, ('low',)", "findings of the type Finding"),
    ],
)
def test_a_rule_with_another_result_is_named(site, result, message):
    text = example()["my_floor.py"].replace("    take = evidence.take\n", f"    return {result}\n")
    install(site, "bad-rules", "2", {"bad_rule.py": text}, {"mocapclean.rules": {"bad": "bad_rule"}})
    with pytest.raises(PackageError, match=f"bad of bad-rules 2 failed: ValueError: examine must return {message}"):
        mocapclean.detect(mocapclean.read(SAMPLES / "walk.c3d").crop(0, 60), also=["bad"])


def test_a_parameter_without_a_meaning_is_named(site):
    text = example()["my_travel.py"].replace(', About(symbol="a", text="share of the travel that is followed")', "")
    install(site, "terse", "1", {"terse_module.py": text}, {"mocapclean.methods": {"terse": "terse_module"}})
    listed = run("methods")
    assert listed.exit_code == 1
    assert "the parameter share must have one About in its annotation" in listed.stderr


def test_the_page_lists_the_laws():
    rows = re.findall(r"^\| `(\w+)` \| (yes|no) \| (.*) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert rows == [(law.name, "yes" if law.is_required else "no", law.statement) for law in LAWS]
