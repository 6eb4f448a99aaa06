"""What the project says of itself in several files is the same everywhere."""

import re
import tomllib
from pathlib import Path

import jsonschema
import pytest
from ruamel.yaml import YAML

import mocapclean

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
RECIPE = ROOT / "packaging" / "conda" / "recipe.yaml"
CONDA_NAMES = {"matplotlib": "matplotlib-base"}
"""Packages that conda names otherwise."""


def text(*parts):
    return ROOT.joinpath(*parts).read_text(encoding="utf-8")


def yaml(*parts):
    return YAML(typ="safe").load(text(*parts))


def conda_form(requirement):
    """A requirement as a recipe writes it: ``numpy>=1.26`` is ``numpy >=1.26``."""
    name, bound = re.fullmatch(r"([\w.]+)(>=[\d.]+)", requirement).groups()
    return f"{CONDA_NAMES.get(name, name)} {bound}"


def test_the_version_is_the_same_everywhere():
    assert PROJECT["dynamic"] == ["version"]
    assert yaml("CITATION.cff")["version"] == mocapclean.__version__
    assert yaml("packaging", "conda", "recipe.yaml")["context"]["version"] == mocapclean.__version__
    assert f"## [{mocapclean.__version__}]" in text("CHANGELOG.md")


def test_the_licence_and_the_authors_are_the_same_everywhere():
    (author,) = PROJECT["authors"]
    citation, about = yaml("CITATION.cff"), yaml("packaging", "conda", "recipe.yaml")["about"]
    assert citation["authors"] == [author]
    assert author["name"] in text("LICENSE")
    assert {PROJECT["license"], citation["license"], about["license"], text("LICENSE").split()[0]} == {"MIT"}
    assert about["summary"] == PROJECT["description"]


CITATION_FORM = {
    "type": "object",
    "required": ["cff-version", "message", "title", "authors"],
    "additionalProperties": False,
    "properties": {
        "cff-version": {"const": "1.2.0"},
        "message": {"type": "string"},
        "type": {"enum": ["software", "dataset"]},
        "title": {"type": "string"},
        "abstract": {"type": "string"},
        "version": {"type": "string"},
        "license": {"type": "string"},
        "keywords": {"type": "array", "items": {"type": "string"}, "uniqueItems": True, "minItems": 1},
        "authors": {
            "type": "array",
            "minItems": 1,
            "items": {"type": "object", "required": ["name"], "properties": {"name": {"type": "string"}}},
        },
    },
}
"""The keys of the Citation File Format 1.2.0 that the project uses."""


def test_the_citation_has_the_citation_file_format():
    jsonschema.validate(yaml("CITATION.cff"), CITATION_FORM)


def test_the_change_log_has_the_headings_of_keep_a_changelog():
    headings = re.findall(r"^### (.*)$", text("CHANGELOG.md"), re.MULTILINE)
    assert headings
    assert set(headings) <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


def test_the_recipe_for_conda_has_the_dependencies_of_the_project():
    recipe = yaml("packaging", "conda", "recipe.yaml")
    extras = PROJECT["optional-dependencies"]
    wanted = [conda_form(each) for each in (*PROJECT["dependencies"], *extras["html"])]
    assert recipe["requirements"]["run"] == ["python >=${{ python_min }}", *wanted]
    assert f">={recipe['context']['python_min']}" == PROJECT["requires-python"]
    assert recipe["requirements"]["run_constraints"] == [
        conda_form(each) for each in (*extras["plots"], *extras["cluster"])
    ]
    ((name, target),) = PROJECT["scripts"].items()
    assert recipe["build"]["python"]["entry_points"] == [f"{name} = {target}"]
    for test in recipe["tests"][1:]:
        assert all((ROOT / path).is_file() for path in test["files"]["source"])


def test_the_recipe_for_conda_can_be_rendered():
    builder = pytest.importorskip("rattler_build", reason="py-rattler-build is not installed (extra package)")
    (variant,) = builder.Stage0Recipe.from_file(str(RECIPE)).render()
    package = variant.recipe.package
    assert (str(package.name), str(package.version)) == ("mocapclean", mocapclean.__version__)


def test_every_extra_is_in_the_table_of_extras():
    section = text("docs", "install.md").split("## Extras")[1].split("\n## ")[0]
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]*) \|", section, re.MULTILINE))
    assert set(rows) == set(PROJECT["optional-dependencies"])
    for extra, packages in rows.items():
        named = set(re.findall(r"[\w.-]+", packages))
        of_project = {re.match(r"[\w.-]+", each)[0] for each in PROJECT["optional-dependencies"][extra]}
        assert named == of_project - {"mocapclean"}, extra


def test_the_pythons_that_are_named_are_those_that_are_allowed():
    lowest = PROJECT["requires-python"].removeprefix(">=")
    named = [each.rsplit(" ", 1)[1] for each in PROJECT["classifiers"] if "Python :: 3." in each]
    assert named[0] == lowest
    assert named == sorted(named, key=lambda version: int(version.split(".")[1]))


def test_the_image_is_made_of_files_that_exist():
    """What the image needs is not ignored, and the build's copy is what the wheel is made of."""
    kept = re.findall(r"^!(.+)$", text("packaging", "Dockerfile.dockerignore"), re.MULTILINE)
    assert {"mocapclean", "pyproject.toml", PROJECT["readme"], *PROJECT["license-files"]} == set(kept)
    assert all((ROOT / path).exists() for path in kept)
    extras = re.findall(r"\[([\w,]+)\]", text("packaging", "Dockerfile"))
    assert extras == ["html,plots", "html,plots"]
    (python,) = set(re.findall(r"^FROM python:([\d.]+)-slim", text("packaging", "Dockerfile"), re.MULTILINE))
    assert f"Programming Language :: Python :: {python}" in PROJECT["classifiers"]
