"""The documents say what is true: their code runs, their tables and examples are complete."""

import re
import shlex
from dataclasses import fields
from pathlib import Path

import pytest
from click.testing import CliRunner

from mocapclean.cli import cli
from mocapclean.config.loading import resolve
from mocapclean.config.settings import Settings
from mocapclean.detection import RULES
from mocapclean.solvers import SOLVERS

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(path, language):
    return re.findall(rf"```{language}\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL)


def test_python_in_the_readme_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    (code,) = blocks(ROOT / "README.md", "python")
    exec(compile(code, "README.md", "exec"), {})
    assert (tmp_path / "walk_clean.c3d").exists()


def test_commands_in_the_readme_are_understood():
    lines = [line for block in blocks(ROOT / "README.md", "sh") for line in block.splitlines()]
    commands = [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("mocapclean ")]
    assert commands
    for name, *arguments in commands:
        command = cli.get_command(None, name)
        command.make_context(name, [a.replace("*", "take") for a in arguments])


def test_every_key_has_a_documented_example(tmp_path):
    (text,) = blocks(ROOT / "docs" / "configuration.md", "yaml")
    path = tmp_path / "studio.yaml"
    path.write_text(text, encoding="utf-8")
    settings = resolve(path, {})
    assert settings.model_fields_set == set(Settings.model_fields)
    assert settings.trust.model_fields_set == set(RULES)
    assert settings.methods.model_fields_set == set(SOLVERS)
    for name, module in RULES.items():
        section = re.split(r"\n {0,2}\w", text.split("\ntrust:", 1)[1].split(f"\n  {name}:", 1)[1])[0]
        for field in fields(module.Params):
            assert f"\n    {field.name}:" in section, f"trust.{name}.{field.name}"
    for name, module in SOLVERS.items():
        section = text.split(f"\n  {name}:", 1)[1]
        for field in fields(module.Params):
            assert f"\n    {field.name}:" in section, f"{name}.{field.name}"


@pytest.mark.parametrize("name", SOLVERS)
def test_every_method_is_in_the_tables_and_has_its_entry(name):
    assert f"| `{name}`" in (ROOT / "README.md").read_text(encoding="utf-8")
    entry = (ROOT / "docs" / "methods.md").read_text(encoding="utf-8").split(f"## `{name}`", 1)[1].split("\n## ")[0]
    for part in ("Model", "When", "Fails", "Cost"):
        assert f"**{part}" in entry


def test_links_lead_somewhere():
    for document in DOCUMENTS:
        for target in re.findall(r"\]\(([^)#:]+)\)", document.read_text(encoding="utf-8")):
            assert (document.parent / target).exists(), f"{document.name}: {target}"


CALL = {"files", "config", "assignments", "no_report", "as_json", "resume"}
CALL |= {"files_from", "null", "relative_to", "shard"}


def test_every_option_is_a_configuration_key():
    command = cli.get_command(None, "fill")
    names = {parameter.name for parameter in command.params} - CALL
    assert names == set(Settings.model_fields) - {"methods", "trust", "check", "grades", "hiding", "auto"}


def test_help_is_given_for_every_command():
    for name in cli.list_commands(None):
        result = CliRunner().invoke(cli, [name, "--help"])
        assert result.exit_code == 0
        assert "Usage:" in result.stdout
