"""Laws of all commands: an option has one meaning, and a help that is complete and shown whole."""

import os
import re
from collections import defaultdict

import click
import pytest
from click.testing import CliRunner

from mocapclean.cli import cli
from mocapclean.cli.options import PURPOSES

COMMANDS = cli.list_commands(None)
WORDS = 3
"""Words at the start of a help text that all commands share."""


def options():
    """The options of all commands: (command, option) by the longest name of the option."""
    found = defaultdict(list)
    for name in COMMANDS:
        for param in cli.get_command(None, name).params:
            if isinstance(param, click.Option):
                found[max(param.opts, key=len)].append((name, param))
    return found


def form(param):
    """What an option takes: its type, whether it is a flag or repeatable, its other names."""
    choices = tuple(param.type.choices) if isinstance(param.type, click.Choice) else ()
    ranges = (param.type.min, param.type.max) if isinstance(param.type, click.IntRange) else ()
    return (
        *(param.type.name, choices, ranges, param.is_flag, param.multiple),
        *(tuple(param.opts), tuple(param.secondary_opts)),
    )


SHARED = {name: uses for name, uses in options().items() if len(uses) > 1}


def test_many_options_are_shared():
    assert {"--json", "--set", "--overwrite", "--quiet", "--workers", "--frames", "--output"} <= set(SHARED)


@pytest.mark.parametrize("name", sorted(SHARED))
def test_an_option_means_the_same_in_every_command(name):
    forms = {command: form(param) for command, param in SHARED[name]}
    assert len(set(forms.values())) == 1, forms
    starts = {command: re.findall(r"\w+", param.help)[:WORDS] for command, param in SHARED[name]}
    assert len(set(map(tuple, starts.values()))) == 1, starts


def test_takes_are_named_alike_in_every_command():
    for name in COMMANDS:
        for param in cli.get_command(None, name).params:
            if isinstance(param, click.Argument) and param.nargs == -1 and param.name != "names":
                assert param.name == "files"
                assert "FILES_OR_FOLDERS" in param.metavar


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_has_a_help_under_one_heading(name):
    command = cli.get_command(None, name)
    context = click.Context(command, info_name=name)
    listed = [param for params in command.by_purpose(context).values() for param in params]
    assert sorted(map(id, listed)) == sorted(id(p) for p in command.get_params(context) if isinstance(p, click.Option))
    for param in listed:
        assert param.help, param.name
        assert param.help[0].isupper(), param.help
        assert param.help.endswith((".", ")")), param.help


def test_no_option_has_two_purposes_and_each_is_used():
    names = [name for group in PURPOSES.values() for name in group]
    assert len(names) == len(set(names))
    assert {f"--{name}" for name in names} <= {*options(), "--help"}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_an_example_that_it_understands(name):
    command = cli.get_command(None, name)
    lines = [line.strip() for line in command.epilog.splitlines() if "mocapclean " in line]
    assert lines
    for line in lines:
        words = re.search(r"mocapclean (\w+) ?([^)|>#]*)", line)
        assert words[1] == name
        arguments = [word.strip("'\"") for word in words[2].split()]
        command.make_context(name, arguments)
    help_text = CliRunner().invoke(cli, [name, "--help"], terminal_width=80).stdout
    for line in lines:
        assert line in help_text


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_fits_a_terminal(name):
    text = CliRunner().invoke(cli, [name, "--help"], terminal_width=80).stdout
    assert "..." not in re.sub(r"\.\.\.\]?($|\s)|, \.\.\.|capsule:\.\.\.", " ", text)
    example = text.split("Examples:")[1]
    for line in text.removesuffix(example).splitlines():
        assert len(line) <= 80, line


def test_every_summary_is_shown_whole():
    text = CliRunner().invoke(cli, ["--help"], terminal_width=80).stdout
    for name, summary in cli.summaries.items():
        assert re.search(rf"^ *{name} +{re.escape(summary)}$", text, re.MULTILINE), name
    assert os.linesep not in "".join(cli.summaries.values())
