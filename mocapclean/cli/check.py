"""``mocapclean check``: check takes against limits, for people and for CI; the takes are not changed."""

from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import (
    AS_JSON,
    FILE,
    HTML,
    OVERWRITE,
    QUIET,
    TAKES,
    Command,
    examples,
    reading,
    verbose,
    working,
)
from mocapclean.cli.stages import stages_shown
from mocapclean.config.presets import PRESETS


@click.command(
    "check",
    cls=Command,
    epilog=examples(
        "mocapclean check captures/ --preset gait-lab",
        "mocapclean check captures/ --config studio.yaml --junit check.xml --report check.json",
    ),
)
@click.argument("files", nargs=-1, required=True, type=FILE, metavar=TAKES)
@click.option(
    "--preset",
    type=click.Choice(list(PRESETS)),
    help="Limits for a purpose; those of --config and --set replace them.",
)
@click.option("--report", "report_file", type=FILE, help="One JSON report for all takes (default: none).")
@click.option("--junit", "junit_file", type=FILE, help="Write JUnit XML: a suite per folder, a case per take.")
@click.option("--summary", type=FILE, help="Write a Markdown summary (default: add it to $GITHUB_STEP_SUMMARY).")
@click.option(
    "--annotations",
    type=click.Choice(["github", "none"]),
    help="Print an annotation for each failing take (default: github where GITHUB_ACTIONS is true).",
)
@HTML
@OVERWRITE
@AS_JSON
@QUIET
@verbose("every exceeded limit, and what to do")
@working
@reading
@guarded
def command(**options: Any) -> int:
    """Check takes (.c3d, .bvh, .amc, .trc, .csv, .tsv) against limits: of a preset, and of the section check.

    A folder stands for all takes in it and below it. Exits 0 when all takes pass, 1 when some fail, 2 when the command
    or the configuration is wrong.
    """
    with stages_shown(options):
        from mocapclean.cli.actions import check

        return check.work(**options)
