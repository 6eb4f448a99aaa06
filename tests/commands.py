"""The commands, as a user types them: in this process, or in one of their own."""

import subprocess
import sys

from click.testing import CliRunner

from mocapclean.cli import cli


def run(*arguments):
    """Run a command in this process: (exit code, standard output, standard error)."""
    result = CliRunner().invoke(cli, [str(a) for a in arguments])
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


def launch(*arguments, **options):
    """Start the command in a process of its own."""
    command = [sys.executable, "-m", "mocapclean", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def files_in(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}
