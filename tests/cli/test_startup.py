"""What the commands load: a library, a method, a rule or a format is imported where it is used, and nowhere else."""

import subprocess
import sys

import pytest

import mocapclean
from mocapclean.cli import cli
from mocapclean.solvers import SOLVERS
from tests.conftest import SAMPLES

LIBRARIES = {
    *("scipy", "pydantic", "ruamel", "tqdm", "pebble", "filelock", "distributed", "matplotlib", "ezc3d", "bvhio"),
    *("asyncio", "multiprocessing", "concurrent", "tempfile", "logging", "xml"),
}
"""What takes long to load, or what only some runs need."""

LISTING = """
import sys
sys.argv = ["mocapclean", *sys.argv[1:]]
from mocapclean.__main__ import main
try:
    main()
finally:
    sys.stderr.write("\\n" + "\\n".join(sorted(sys.modules)))
"""


def loaded(*arguments):
    """The names of the modules that a command loads."""
    command = [sys.executable, "-c", LISTING, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return set(done.stderr.splitlines())


def libraries(modules):
    return {name for name in LIBRARIES if name in modules}


def inside(package, modules):
    """The names of the modules of a package that are loaded, without those of its own packages."""
    prefix = f"mocapclean.{package}."
    return {name.removeprefix(prefix) for name in modules if name.startswith(prefix) and name.count(".") == 2}


def methods(modules):
    return inside("solvers", modules) & set(SOLVERS)


@pytest.fixture(scope="module")
def take(tmp_path_factory):
    """A small C3D file with gaps."""
    path = tmp_path_factory.mktemp("small") / "small.c3d"
    mocapclean.write(mocapclean.read(SAMPLES / "walk.c3d").crop(0, 120), path)
    return path


@pytest.mark.parametrize("name", cli.list_commands(None))
def test_help_loads_neither_a_library_nor_what_works_on_takes(name):
    modules = loaded(name, "--help")
    assert not libraries(modules)
    assert not inside("formats", modules)
    assert not inside("detection", modules)
    assert not inside("pipeline", modules)
    assert not methods(modules)
    assert ("numpy" in modules) == (name == "simulate")


def test_the_version_loads_nothing():
    assert "click" not in loaded("--version")


def test_inspecting_a_c3d_loads_no_method_no_other_format_and_no_library(take):
    modules = loaded("inspect", take)
    assert not libraries(modules)
    assert not methods(modules)
    assert inside("formats", modules) & {"c3d", "bvh", "amc", "asf", "fitting"} == {"c3d"}


def test_checking_a_c3d_loads_no_method_no_other_format_and_no_library(take):
    modules = loaded("check", take)
    assert not libraries(modules)
    assert not methods(modules)
    assert inside("formats", modules) & {"c3d", "bvh", "amc", "asf", "fitting"} == {"c3d"}


@pytest.mark.parametrize("method", ["kriging", "linear"])
def test_a_fill_loads_its_method_alone(take, tmp_path, method):
    modules = loaded("fill", take, "-o", tmp_path / "out.c3d", "--method", method, "--no-self-check")
    assert methods(modules) == {method}
    assert libraries(modules) <= {"scipy", "concurrent", "logging", "tempfile"}  # all but the first come with SciPy
    assert "importlib.metadata" not in modules  # no search for other packages
    assert not {"scipy.linalg", "scipy.interpolate", "scipy.stats", "scipy.signal", "scipy.ndimage"} & modules
    assert inside("formats", modules) & {"c3d", "bvh", "amc", "asf", "fitting"} == {"c3d"}


def test_the_list_of_methods_loads_no_part_of_scipy():
    modules = loaded("methods")
    assert methods(modules) == set(SOLVERS)
    assert libraries(modules) <= {"scipy", "tempfile"}  # the second comes with the search for other packages
    assert not {"scipy.linalg", "scipy.sparse", "scipy.optimize", "scipy.interpolate", "scipy.spatial"} & modules


def test_a_library_is_loaded_where_it_is_needed(take, tmp_path):
    config = tmp_path / "studio.yaml"
    config.write_text("max_gap: 50\n", encoding="utf-8")
    assert libraries(loaded("inspect", take, "--config", config)) >= {"ruamel", "pydantic"}
    assert "pebble" in loaded("check", take, "--timeout", 60)
    assert "filelock" in loaded("fill", take, "--out-dir", tmp_path / "out", "--method", "linear", "--no-self-check")
    assert "xml" in loaded("check", take, "--junit", tmp_path / "junit.xml")
    assert "mocapclean.formats.bvh" in loaded("inspect", SAMPLES / "walk.bvh", "--no-detect")
