"""The documentation site: it builds without a warning, its links lead somewhere, and it has every public name."""

import importlib
import json
import os
import subprocess
import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import jsonschema
import pytest
from filelock import FileLock
from ruamel.yaml import YAML

from mocapclean.cli import cli
from mocapclean.config.settings import Settings
from mocapclean.detection import RULES
from mocapclean.parameters import annotations
from mocapclean.solvers import SOLVERS
from mocapclean.take.status import Status

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """The folder of the site, built once for all processes of the tests; a warning is an error."""
    for name in ("sphinx", "myst_nb", "furo", "sphinx_click", "sphinx_copybutton"):
        pytest.importorskip(name, reason=f"{name} is not installed (extra docs)")
    workers = "PYTEST_XDIST_WORKER" in os.environ
    folder = (tmp_path_factory.getbasetemp().parent if workers else tmp_path_factory.mktemp("built")) / "site"
    with FileLock(f"{folder}.lock"):
        if not (folder / "index.html").exists():
            command = [sys.executable, "-m", "sphinx", "-W", "-q", "-d", f"{folder}.doctrees", "docs", folder]
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
            assert done.returncode == 0, done.stderr
    return folder


class Page(HTMLParser):
    """The targets of a page: its identifiers, and all that it links to or shows."""

    def __init__(self, path):
        super().__init__()
        self.ids, self.links, self.text = set(), set(), []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.ids |= {values[name] for name in ("id", "name") if values.get(name)}
        self.links |= {values[name] for name in ("href", "src") if values.get(name)}

    def handle_data(self, data):
        self.text.append(data)


page = cache(Page)


def pages(site):
    return sorted(path for path in site.rglob("*.html") if "_static" not in path.parts)


def test_every_page_of_the_sources_is_there(site):
    sources = [
        path.relative_to(ROOT / "docs") for kind in ("md", "ipynb") for path in (ROOT / "docs").rglob(f"*.{kind}")
    ]
    assert {path.with_suffix(".html") for path in sources} <= {path.relative_to(site) for path in pages(site)}


def test_every_link_within_the_site_leads_somewhere(site):
    broken, checked = [], 0
    for path in pages(site):
        for link in page(path).links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            checked += 1
            if not target.is_file():
                broken.append(f"{path.relative_to(site)}: {link}")
            elif parts.fragment and target.suffix == ".html" and unquote(parts.fragment) not in page(target).ids:
                broken.append(f"{path.relative_to(site)}: {link} has no such place")
    assert checked > 1000
    assert not broken


def test_the_site_needs_no_network(site):
    """No script, style or picture comes from another place."""
    for path in pages(site):
        text = path.read_text(encoding="utf-8")
        assert '<script src="http' not in text
        assert '<img src="http' not in text
        assert 'rel="stylesheet" href="http' not in text


def test_every_public_name_has_its_place(site, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    import reference_pages

    ids, of_value = page(site / "reference" / "api.html").ids, {}
    for module in reference_pages.PUBLIC:
        for name in reference_pages.public_names(module):
            of_value.setdefault(id(getattr(importlib.import_module(module), name)), []).append(f"{module}.{name}")
    assert [names for names in of_value.values() if not ids & {*names}] == []
    assert {"mocapclean.read", "mocapclean.detect", "mocapclean.fill", "mocapclean.write", "mocapclean.Take"} <= ids


@pytest.mark.parametrize(
    ("name", "things"),
    [
        ("commands", [f"mocapclean {name}" for name in cli.summaries]),
        ("methods", SOLVERS),
        ("rules", RULES),
        ("statuses", [status.code for status in Status]),
        ("configuration", annotations(Settings)),
    ],
)
def test_the_reference_has_everything(site, name, things):
    text = "".join(page(site / "reference" / f"{name}.html").text)
    assert [thing for thing in things if thing not in text] == []


def test_every_option_is_in_the_reference(site):
    text = "".join(page(site / "reference" / "commands.html").text)
    for name in cli.summaries:
        for parameter in cli.get_command(None, name).params:
            assert all(option in text for option in parameter.opts if option.startswith("-")), (name, parameter.opts)


def documented_configuration():
    text = (ROOT / "docs" / "configuration.md").read_text(encoding="utf-8")
    return YAML(typ="safe").load(text.split("```yaml\n", 1)[1].split("```", 1)[0])


def test_the_schema_of_a_configuration_takes_what_the_command_takes(site):
    schema = json.loads((site / "configuration.schema.json").read_text(encoding="utf-8"))
    validator = jsonschema.Draft202012Validator(schema)
    validator.check_schema(schema)
    assert [error.message for error in validator.iter_errors(documented_configuration())] == []
    assert validator.is_valid({"memory": "2GiB", "methods": {"kriging": {"passes": 2}}})
    for wrong in ({"metod": "kriging"}, {"method": "magic"}, {"methods": {"kriging": {"passes": 0}}}, {"max_gap": -1}):
        assert not validator.is_valid(wrong), wrong


def test_the_notebook_has_no_stored_output():
    for path in (ROOT / "docs" / "notebooks").glob("*.ipynb"):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        assert not [cell for cell in cells if cell.get("outputs") or cell.get("execution_count")], path.name


def test_the_notebook_was_run(site):
    path = site / "notebooks" / "from_python.html"
    text = "".join(page(path).text)
    assert "mm in 3D, largest" in text
    assert [link for link in page(path).links if link.startswith("../_images/") and link.endswith(".png")]
