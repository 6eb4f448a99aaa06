"""The wheel and the source distribution: their contents, and a fill in clean environments of every Python at hand."""

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from filelock import FileLock

import mocapclean

ROOT = Path(__file__).resolve().parents[2]
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
CLEAN = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}


def run(*command, **options):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, env=CLEAN, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="session")
def dist(tmp_path_factory):
    """A folder with the wheel and the source distribution, built once for all processes of the tests."""
    pytest.importorskip("build", reason="build is not installed (extra package)")
    workers = "PYTEST_XDIST_WORKER" in os.environ
    folder = (tmp_path_factory.getbasetemp().parent if workers else tmp_path_factory.mktemp("built")) / "dist"
    with FileLock(f"{folder}.lock"):
        if not folder.exists():
            run(sys.executable, "-m", "build", "--installer", "uv", "--outdir", folder, ROOT)
    return folder


@pytest.fixture
def wheel(dist):
    (path,) = dist.glob("*.whl")
    return path


def test_the_wheel_has_the_package_and_nothing_else(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    information = f"mocapclean-{mocapclean.__version__}.dist-info"
    assert {name.split("/")[0] for name in names} == {"mocapclean", information}
    package = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "mocapclean").rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }
    assert {name for name in names if name.startswith("mocapclean/")} == package
    assert {"mocapclean/py.typed", "mocapclean/report/page/page.html", f"{information}/licenses/LICENSE"} <= names


def test_the_source_distribution_has_tests_documents_and_sample_data(dist):
    (path,) = dist.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        names = {name.split("/", 1)[1] for name in archive.getnames() if "/" in name}
    tops = {name.split("/")[0] for name in names}
    assert {"mocapclean", "tests", "docs", "sample_data", "benchmarks", "packaging"} <= tops
    assert {"LICENSE", "README.md", "CITATION.cff", "CHANGELOG.md", "sample_data/walk.c3d"} <= names
    assert ".ci" not in tops
    assert not [name for name in names if name.endswith(".pyc") or name.startswith((".venv", "site/"))]


def test_the_metadata_pass_the_checks_of_the_package_index(dist):
    pytest.importorskip("twine", reason="twine is not installed (extra package)")
    run(sys.executable, "-m", "twine", "check", "--strict", *dist.iterdir())


def python(version):
    """The interpreter of a version, from the path or from pyenv; None where there is none."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    candidates = [shutil.which(f"python{version}"), *sorted(pyenv.glob(f"{version}.*/bin/python"))]
    for path in filter(None, candidates):
        asked = [path, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"]
        if subprocess.run(asked, capture_output=True, text=True).stdout.strip() == version:
            return path
    return None


@pytest.mark.parametrize("version", VERSIONS)
def test_the_wheel_fills_a_take_in_a_clean_environment(version, wheel, tmp_path):
    interpreter = python(version)
    if interpreter is None:
        pytest.skip(f"Python {version} is not installed")
    uv = [sys.executable, "-m", "uv", "--quiet"]
    run(*uv, "venv", "--python", interpreter, tmp_path / "venv")
    scripts = tmp_path / "venv" / ("Scripts" if os.name == "nt" else "bin")
    run(*uv, "pip", "install", "--python", scripts / "python", wheel)
    run(*uv, "pip", "check", "--python", scripts / "python")
    assert run(scripts / "mocapclean", "--version", cwd=tmp_path).strip() == f"mocapclean {mocapclean.__version__}"
    take = ROOT / "sample_data" / "walk.c3d"
    told = run(scripts / "mocapclean", "fill", take, "-o", "filled.c3d", cwd=tmp_path)
    assert "1,000 samples by kriging" in told
    assert (tmp_path / "filled.c3d").stat().st_size == take.stat().st_size


def test_the_image_has_no_fault_that_a_linter_knows():
    hadolint = Path(sys.executable).with_name("hadolint")
    if not hadolint.exists():
        pytest.skip("hadolint is not installed (extra package)")
    run(hadolint, ROOT / "packaging" / "Dockerfile")
