"""``mocapclean convert``: write takes as files of another format."""

from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import (
    AS_JSON,
    FILE,
    FORMAT,
    MARKERS,
    OVERWRITE,
    RATE,
    SKELETON,
    TAKES,
    UNIT,
    Command,
    examples,
    verbose,
)
from mocapclean.cli.stages import stages_shown


@click.command(
    "convert",
    cls=Command,
    epilog=examples(
        "mocapclean convert take.c3d take.trc",
        "mocapclean convert take.csv take.c3d --unit m",
        "mocapclean convert captures/ --out-dir tables/ --to trc",
    ),
)
@click.argument("files", nargs=-1, required=True, type=FILE, metavar=f"{TAKES} [OUTPUT]")
@click.option("--to", metavar="NAME", help="Format of the new files: c3d, trc, csv, qualisys, motive or nexus.")
@click.option("--out-dir", type=FILE, help="Folder for the new files, under their own names; no OUTPUT is given then.")
@OVERWRITE
@SKELETON
@RATE
@UNIT
@FORMAT
@MARKERS
@AS_JSON
@verbose()
@guarded
def command(**options: Any) -> int:
    """Write takes (.c3d, .bvh, .amc, .trc, .csv, .tsv) as files of another format, and say what these do not have.

    Skeletons become markers at their joints. A folder stands for all takes in it and below it; --out-dir then has
    the same tree.
    """
    with stages_shown(options):
        from mocapclean.cli.actions import convert

        return convert.work(**options)
