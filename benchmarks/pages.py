"""Run the commands of pages of docs/ and put their output into the pages: python benchmarks/pages.py docs/tutorial.md

A block ``console`` has commands after "$ ", each followed by its output. A block ``yaml`` whose first line is
"# NAME" is the file NAME. The commands run one after the other in a folder with the sample takes.
"""

import contextlib
import os
import re
import shlex
import shutil
import sys
import tempfile
from pathlib import Path

from click.testing import CliRunner

from mocapclean.cli import cli

ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"^```(console|yaml)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
DURATION = re.compile(r"^( +done +)\d+\.\d s", re.MULTILINE)
"""The only numbers of an output that differ from run to run."""


def ran(text: str) -> str:
    """Return a page with the output of its commands, run in a temporary folder with the sample takes."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(ROOT / "sample_data", folder, dirs_exist_ok=True)
        with contextlib.chdir(folder):
            status = ["0"]
            return BLOCK.sub(lambda block: f"```{block[1]}\n{_ran_block(block[1], block[2], status)}```", text)


def _ran_block(kind: str, content: str, status: list[str]) -> str:
    """Return the content of a block: a file is written, and commands are followed by their output.

    status: the exit code of the last command, which ``echo $?`` prints.
    """
    if kind == "yaml":
        if named := re.match(r"# (\S+\.yaml)\n", content):
            Path(named[1]).write_text(content, encoding="utf-8")
        return content
    lines = []
    for command in re.findall(r"^\$ (.*)$", content, re.MULTILINE):
        if command == "echo $?":
            output = f"{status[0]}\n"
        else:
            output, status[0] = _output(command)
        lines.append(f"$ {command}\n{output}")
    return "".join(lines)


def _output(command: str) -> tuple[str, str]:
    """Return what a command of mocapclean prints, and its exit code."""
    program, *arguments = shlex.split(command)
    if program != "mocapclean":
        raise ValueError(f"a command of a page must be mocapclean. Got {program!r}.")
    result = CliRunner().invoke(cli, arguments, terminal_width=80, prog_name="mocapclean")
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.output, str(result.exit_code)


def without_durations(text: str) -> str:
    """Return a page without the numbers that differ from run to run."""
    return DURATION.sub(r"\1TIME s", text)


def main() -> None:
    for name in sys.argv[1:]:
        path = Path(name)
        path.write_text(ran(path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
