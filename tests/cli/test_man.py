"""The manual pages: one for each command, whole, and without a complaint of troff."""

import re
import shutil
import subprocess

import click
import pytest
from commands import files_in, run

from mocapclean.cli import cli
from mocapclean.cli.actions.man import pages

PAGES = pages()


def test_every_command_has_a_page():
    assert set(PAGES) == {"mocapclean.1", *(f"mocapclean-{name}.1" for name in cli.list_commands(None))}


@pytest.mark.parametrize("name", cli.list_commands(None))
def test_a_page_has_every_option_and_example(name):
    page = PAGES[f"mocapclean-{name}.1"].replace("\\-", "-")
    command = cli.get_command(None, name)
    for param in command.params:
        if isinstance(param, click.Option):
            assert f"{max(param.opts, key=len)}" in page
    assert all(line.strip() in page for line in command.epilog.splitlines()[3:])
    headings = re.findall(r"^\.SH (.*)$", page, re.MULTILINE)
    assert headings[:3] == ["NAME", "SYNOPSIS", "DESCRIPTION"]
    assert headings[-3:] == ["EXAMPLES", "EXIT STATUS", "SEE ALSO"]


@pytest.mark.parametrize("name", PAGES)
@pytest.mark.skipif(shutil.which("groff") is None, reason="groff is not installed")
def test_troff_has_no_complaint(name):
    done = subprocess.run(
        ["groff", "-man", "-Tutf8", "-P-cbou", "-ww"],
        input=PAGES[name],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert not done.stderr
    assert "EXIT STATUS" in done.stdout


def test_pages_are_written_and_not_over_others(tmp_path):
    assert run("man", "--out-dir", tmp_path / "man1")[0] == 0
    assert {name: text.encode() for name, text in PAGES.items()} == files_in(tmp_path / "man1")
    code, _, err = run("man", "--out-dir", tmp_path / "man1")
    assert code == 2
    assert "--overwrite" in err
    assert run("man", "--out-dir", tmp_path / "man1", "--overwrite")[0] == 0
