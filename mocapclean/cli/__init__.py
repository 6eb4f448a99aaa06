"""The command line: the only place that prints, shows progress or decides an exit code."""

import click

from mocapclean import __version__


class Commands(click.Group):
    """Commands in the order in which a user meets them, each loaded when it is called."""

    homes = ("fill", "inspect", "check", "methods", "train", "simulate", "bench")

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The names of all commands."""
        return list(self.homes)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the module of one command."""
        if cmd_name not in self.homes:
            return None
        from importlib import import_module

        command: click.Command = import_module(f"mocapclean.cli.{cmd_name}").command
        return command


@click.command(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(__version__, prog_name="mocapclean", message="%(prog)s %(version)s")
def cli() -> None:
    """Clean motion-capture files: detect what cannot be trusted, fill it, change nothing else."""
