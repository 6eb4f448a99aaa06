"""``mocapclean plot``: figures of takes as PNG, SVG or PDF; the takes are not changed."""

from typing import Any

import click

from mocapclean.cli import completing
from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE, METHOD, OUTPUT, OVERWRITE, TAKES, Command, examples, reading, verbose
from mocapclean.cli.stages import stages_shown


@click.command(
    "plot",
    cls=Command,
    epilog=examples(
        "mocapclean plot take.c3d -o gaps.png",
        "mocapclean plot take.c3d --marker LANK --frames 100:400 -o curves.svg",
    ),
)
@click.argument("files", nargs=-1, required=True, type=FILE, metavar=TAKES)
@click.option("-o", "--output", type=FILE, required=True, help=f"{OUTPUT}a figure, .png, .svg or .pdf.")
@click.option(
    "--marker",
    metavar="NAME",
    shell_complete=completing.markers,
    help="The curves of this marker before and after, with the 90 % band.",
)
@click.option("--bones", is_flag=True, help="The lengths of the worst bones over time, before and after.")
@METHOD
@OVERWRITE
@reading
@verbose()
@guarded
def command(**options: Any) -> int:
    """Draw the map of the samples of takes (.c3d, .bvh, .amc, .trc, .csv, .tsv): what is missing, distrusted and
    suspicious, and when.

    Several takes share one sheet. With --marker or --bones one take is filled as 'mocapclean fill' would, in a
    temporary folder, and its curves are drawn before and after.
    """
    with stages_shown(options):
        from mocapclean.cli.actions import plot

        return plot.work(**options)
