"""``mocapclean bench``: run the papers' experiments, and show the results beside the printed values."""

from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE
from mocapclean.experiments.protocols import EXPERIMENTS


@click.command("bench")
@click.argument("experiment", type=click.Choice(list(EXPERIMENTS)))
@click.argument("files", nargs=-1, type=FILE, metavar="[FILES]...")
@click.option("--folder", type=FILE, help="Folder in which FILES are names; without FILES, of the paper's takes.")
@click.option("--quick", is_flag=True, help="Fewer losses, methods and frames: about a minute.")
@click.option("--seeds", type=click.IntRange(min=1), help="Repetitions with other losses (default: 3; 1 with --quick).")
@click.option("--frames", type=click.IntRange(min=1), help="Use only the first frames of each take, at most this many.")
@click.option(
    "--mask-from", multiple=True, type=FILE, help="Capture with natural gaps to put into the takes; for occlusion."
)
@click.option("--methods", multiple=True, metavar="NAME", help="Only these methods; also others than the paper's.")
@click.option("--set", "assignments", multiple=True, metavar="METHOD.KEY=VALUE", help="Set a parameter of a method.")
@click.option("--dictionary", type=FILE, help="The file that 'mocapclean train' wrote, for llc and srmmp.")
@click.option("--skeleton", type=FILE, help="The .asf of the .amc files, if it is in another folder.")
@click.option("--rate", type=float, help="Frames per second, for files without a rate (AMC: 120).")
@click.option(
    "--unit", help="Unit of length of BVH files: mm, cm, m, in, or mm per unit (default: cm; inferred in skeletons)."
)
@click.option(
    "--out-dir",
    type=FILE,
    default="bench",
    show_default=True,
    help="Folder for results; finished trials are not repeated.",
)
@click.option("--overwrite", is_flag=True, help="Delete the experiment's results first.")
@click.option("--plots/--no-plots", "wants_plots", default=True, help="Draw figures; needs the extra 'plots'.")
@guarded
def command(**options: Any) -> int:
    """Run an EXPERIMENT on FILES (.c3d, .bvh, .amc), whose trusted samples are the truth.

    Writes EXPERIMENT.csv with one row per finished trial, .json, .txt and figures. Ctrl-C keeps the finished rows. The
    same command then continues.
    """
    from mocapclean.cli.work import bench

    return bench.work(**options)
