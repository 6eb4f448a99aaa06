"""``mocapclean bench``: run the papers' experiments, and show the results beside the printed values."""

from typing import Any

import click

from mocapclean.cli import completing
from mocapclean.cli.guard import guarded
from mocapclean.cli.options import (
    DICTIONARY,
    FILE,
    RATE,
    SKELETON,
    TAKES,
    UNIT,
    Command,
    examples,
    overwriting,
    verbose,
)
from mocapclean.experiments.protocols import EXPERIMENTS


@click.command(
    "bench",
    cls=Command,
    epilog=examples(
        "mocapclean bench compare take.c3d",
        "mocapclean bench markers --folder captures/ --quick",
    ),
)
@click.argument("experiment", type=click.Choice(list(EXPERIMENTS)))
@click.argument("files", nargs=-1, type=FILE, metavar=f"[{TAKES}]")
@click.option("--quick", is_flag=True, help="Fewer losses, methods and frames: about a minute.")
@click.option("--seeds", type=click.IntRange(min=1), help="Repetitions with other losses (default: 3; 1 with --quick).")
@click.option(
    "--methods",
    multiple=True,
    metavar="NAME",
    shell_complete=completing.methods,
    help="Only these methods; also others than the paper's.",
)
@DICTIONARY
@click.option("--folder", type=FILE, help="Folder in which FILES are names; without FILES, of the paper's takes.")
@click.option("--most-frames", type=click.IntRange(min=1), help="Use at most so many frames of each take, the first.")
@click.option(
    "--mask-from", multiple=True, type=FILE, help="Capture with natural gaps to put into the takes; for occlusion."
)
@SKELETON
@RATE
@UNIT
@click.option(
    "--set",
    "assignments",
    multiple=True,
    metavar="KEY=VALUE",
    shell_complete=completing.keys,
    help="Set any key of the configuration, as a.b=value; here methods.METHOD.PARAMETER=value alone.",
)
@click.option(
    "--out-dir",
    type=FILE,
    default="bench",
    show_default=True,
    help="Folder for the results; finished trials in it are not repeated.",
)
@overwriting(default=False)
@click.option("--plots/--no-plots", "wants_plots", default=True, help="Draw figures; needs the extra 'plots'.")
@verbose()
@guarded
def command(**options: Any) -> int:
    """Run an EXPERIMENT on takes (.c3d, .bvh, .amc, .trc, .csv, .tsv), whose trusted samples are the truth.

    Writes EXPERIMENT.csv with one row per finished trial, .json, .txt and figures. Ctrl-C keeps the finished rows. The
    same command then continues; with --overwrite it begins anew.
    """
    from mocapclean.cli.actions import bench

    return bench.work(**options)
