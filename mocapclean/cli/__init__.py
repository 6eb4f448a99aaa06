"""The command line: the only package that prints, shows progress or decides an exit code."""

import click

from mocapclean import __version__


class Commands(click.Group):
    """A group whose commands are imported when they are called, so that ``--help`` is shown at once."""

    summaries = {  # noqa: RUF012
        "fill": "Repair takes and write them with a report.",
        "inspect": "Show markers, frames, gaps and findings; write nothing.",
        "check": "Check takes against limits, for people and for CI.",
        "report": "Write the page of a report, with pictures, for any browser.",
        "plot": "Draw gaps, curves or bones of takes as PNG, SVG or PDF.",
        "convert": "Write takes as files of another format.",
        "methods": "List the methods with their sources and parameters.",
        "train": "Learn a dictionary for llc and srmmp from clean takes.",
        "simulate": "Write simulated takes with gaps, faults and the truth.",
        "bench": "Run an experiment of a paper on your takes.",
        "config": "Write a configuration with every key, or its JSON Schema.",
        "completion": "Print the script by which a shell completes commands.",
        "man": "Write the manual pages.",
    }

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands, in the order in which a new user needs them."""
        return list(self.summaries)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command, imported from its module; None for an unknown name."""
        if cmd_name not in self.summaries:
            return None
        from importlib import import_module

        command: click.Command = import_module(f"mocapclean.cli.{cmd_name}").command
        command.short_help = self.summaries[cmd_name]
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write one line per command, without importing any of them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(self.summaries.items()))


@click.command(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(__version__, prog_name="mocapclean", message="%(prog)s %(version)s")
def cli() -> None:
    """Clean motion-capture files: detect untrustworthy samples, fill them, change nothing else."""
