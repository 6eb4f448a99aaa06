"""``mocapclean config``: the written configuration is the defaults, and the schema says what a configuration may be."""

import json
import re
from dataclasses import is_dataclass
from pathlib import Path

import jsonschema
import pytest
from commands import run
from ruamel.yaml import YAML

from mocapclean.config.loading import names_of, resolve, section_of
from mocapclean.config.presets import PRESETS
from mocapclean.config.settings import Methods, Settings
from mocapclean.config.template import as_yaml, schema
from mocapclean.detection import RULES
from mocapclean.json_values import plain
from mocapclean.solvers import SOLVERS

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "configuration.md"
TEXT, SCHEMA = as_yaml(Settings()), schema()


def documented():
    text = DOCUMENT.read_text(encoding="utf-8").split("<!-- every key -->\n```yaml\n")[1].split("```")[0]
    return YAML(typ="safe", pure=True).load(text)


def sections(section, path=()):
    """Yield the path of every key in a section of the settings."""
    for name in names_of(section) or ():
        inner = section_of(section, name)
        yield (*path, name)
        if isinstance(inner, type) and (is_dataclass(inner) or hasattr(inner, "modules")):
            yield from sections(inner, (*path, name))


ALL_KEYS = list(sections(Settings))
OPEN = {("check", name) for preset in PRESETS.values() for name in preset}
"""Keys that are written as comments, because a limit that is written comes before that of a preset."""


def value_at(tree, path):
    for key in path:
        tree = tree[key]
    return tree


def test_the_written_file_gives_the_defaults(tmp_path):
    path = tmp_path / "studio.yaml"
    path.write_text(TEXT, encoding="utf-8")
    settings, default = resolve(path, {}), Settings()
    assert settings == default
    assert {name: plain(value) for name, value in settings} == {name: plain(value) for name, value in default}
    assert set(settings.methods.given) == set(SOLVERS)
    assert set(settings.trust.given) == set(RULES)


def test_every_key_is_written_with_its_default_and_a_comment():
    assert len(ALL_KEYS) > 250
    tree = YAML(typ="safe", pure=True).load(TEXT)
    defaults = {name: plain(value) for name, value in Settings()}
    written = {**defaults, "check": {k: v for k, v in defaults["check"].items() if ("check", k) not in OPEN}}
    lines = TEXT.splitlines()
    commented = YAML(typ="rt").load(TEXT)
    for path in ALL_KEYS:
        if path in OPEN:
            assert f"  # {path[1]}: {json.dumps(value_at(defaults, path))}" in lines
            continue
        assert value_at(tree, path) == value_at(written, path), path
        line = value_at(commented, path[:-1]).lc.key(path[-1])[0]
        assert lines[line - 1].lstrip().startswith("# "), path
    assert max(map(len, lines)) <= 120


def test_a_preset_chosen_in_the_written_file_sets_its_limits(tmp_path):
    path = tmp_path / "studio.yaml"
    path.write_text(TEXT.replace("preset: null", "preset: film"), encoding="utf-8")
    chosen = resolve(path, {})
    assert {name: getattr(chosen.check, name) for name in PRESETS["film"]} == PRESETS["film"]
    path.write_text(as_yaml(chosen), encoding="utf-8")
    assert resolve(path, {}) == chosen


def test_the_long_sections_come_last():
    assert list(YAML(typ="safe", pure=True).load(TEXT))[-2:] == ["methods", "trust"]


def test_numbers_with_an_exponent_are_numbers_in_all_versions_of_yaml():
    exponents = [line for line in TEXT.splitlines() if re.match(r"\s*\w+: -?[\d.]+e-", line)]
    assert exponents
    assert all(re.search(r": -?\d+\.\d+e[+-]\d+$", line) for line in exponents)


def test_other_values_survive_as_well(tmp_path):
    settings = resolve(None, {"max_left": "2%", "markers": ["L*", "no"], "unit": 56.4, "frames": "1:9"}, ["passes=2"])
    path = tmp_path / "studio.yaml"
    path.write_text(as_yaml(settings), encoding="utf-8")
    again = resolve(path, {})
    assert {name: plain(value) for name, value in again} == {name: plain(value) for name, value in settings}


def test_the_schema_is_one_and_takes_what_is_taken():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    for tree in (YAML(typ="safe", pure=True).load(TEXT), documented()):
        jsonschema.validate(tree, SCHEMA)


@pytest.mark.parametrize(
    "tree",
    [
        {"metod": "kriging"},
        {"method": "magic"},
        {"max_gap": "many"},
        {"trust": {"spike": {"least": 1.0}}},
        {"trust": {"spikes": {}}},
        {"methods": {"kriging": {"passess": 2}}},
        {"check": {"preset": "nobody"}},
        {"check": {"markers": {"*": {"missing": -1}}}},
    ],
)
def test_the_schema_refuses_what_is_refused(tree):
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(tree, SCHEMA)


def test_every_key_is_described_in_the_schema():
    for path in ALL_KEYS:
        part = SCHEMA
        for key in path:
            part = part["properties"][key]
            described = "description" in part
            if "$ref" in part:
                part = SCHEMA["$defs"][part["$ref"].rpartition("/")[2]]
        assert described or "description" in part, path


def test_the_command_prints_or_writes(tmp_path):
    assert run("config", "--init") == (0, TEXT, "")
    path = tmp_path / "studio.yaml"
    assert run("config", "--init", "-o", path) == (0, "", "")
    assert path.read_text(encoding="utf-8") == TEXT
    code, _, err = run("config", "--init", "-o", path)
    assert code == 2
    assert "--overwrite" in err
    assert json.loads(run("config", "--schema")[1]) == SCHEMA
    (tmp_path / "own.yaml").write_text("max_gap: 7\ncheck: {preset: film, missing: 3}\n", encoding="utf-8")
    shown = YAML(typ="safe", pure=True).load(run("config", "--show", tmp_path / "own.yaml")[1])
    assert shown["max_gap"] == 7
    assert (shown["check"]["preset"], shown["check"]["missing"], shown["check"]["bone_deviation"]) == (
        "film",
        3.0,
        60.0,
    )


@pytest.mark.parametrize("arguments", [(), ("--init", "--show", "x.yaml"), ("--init", "--schema")])
def test_one_thing_is_asked_for(arguments):
    assert run("config", *arguments)[0] == 2


def test_the_methods_are_those_of_the_code():
    assert set(SCHEMA["properties"]["methods"]["properties"]) == set(Methods.modules)
