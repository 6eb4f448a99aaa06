"""``mocapclean fill``: repair takes, and write them and their reports."""

from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import (
    AS_JSON,
    DICTIONARY,
    FILE,
    HTML,
    METHOD,
    OUTPUT,
    OVERWRITE,
    QUIET,
    TAKES,
    Command,
    batching,
    examples,
    reading,
    verbose,
)
from mocapclean.cli.stages import stages_shown


@click.command(
    "fill",
    cls=Command,
    epilog=examples(
        "mocapclean fill take.c3d",
        "mocapclean fill captures/ --out-dir clean/ --html report.html",
        "mocapclean fill take.c3d --frames 100:400",
    ),
)
@click.argument("files", nargs=-1, type=FILE, metavar=f"[{TAKES}]")
@click.option("-o", "--output", type=FILE, help=f"{OUTPUT}the repaired take, for one input; same format as the input.")
@click.option("--out-dir", type=FILE, help="Folder for the repaired files, under their own names.")
@OVERWRITE
@METHOD
@DICTIONARY
@click.option(
    "--learn-from",
    type=FILE,
    multiple=True,
    help="Learn also from other takes of the same subject: a file or a folder; repeatable (kriging, pca, pma).",
)
@click.option("--max-gap", type=int, metavar="FRAMES", help="Leave longer gaps unfilled.")
@click.option(
    "--replace",
    type=click.Choice(["sure", "suspicious", "missing"]),
    help="Measured samples to replace: of sure findings (default), of all findings, or none.",
)
@click.option("--only-missing", is_flag=True, help="Replace no measured sample; the same as --replace missing.")
@click.option(
    "--fill-poor/--no-fill-poor", default=None, help="Also fill gaps that are graded poor or would bend a rigid pair."
)
@click.option(
    "--keep-contacts/--no-keep-contacts",
    default=None,
    help="Skeletons: keep feet in place that stand still on both sides of a repaired span.",
)
@click.option("--max-error", type=float, metavar="MM", help="Leave gaps with a larger expected 3D error unfilled.")
@click.option("--self-check/--no-self-check", default=None, help="Measure the error on hidden samples of the take.")
@click.option("--fix-swaps/--no-fix-swaps", default=None, help="Exchange swapped labels; coordinates stay as they are.")
@click.option("--max-left", help="Exit 1 if more samples stay unfilled: a number, or a percentage such as 2%.")
@click.option(
    "--invalidate/--no-invalidate", default=None, help="Mark distrusted, unfilled samples as missing (markers only)."
)
@click.option("--reference", type=FILE, help="The true take; adds the RMSE of the filled samples to the report.")
@click.option("--report", type=FILE, help="One JSON report for all takes (default: one beside each output).")
@HTML
@click.option("--sidecar", type=FILE, help="Also write arrays (.npz): a file for one input, or a folder.")
@click.option("--no-report", is_flag=True, help="Write no report.")
@QUIET
@verbose("every gap and finding")
@click.option("--resume", is_flag=True, help="Skip takes that an earlier run into --out-dir finished, if unchanged.")
@AS_JSON
@batching
@reading
@guarded
def command(**options: Any) -> int:
    """Fill the samples of takes (.c3d, .bvh, .amc, .trc, .csv, .tsv) that cannot be trusted, and change nothing else.

    Writes take_filled.c3d and take_filled.c3d.report.json beside take.c3d, or into --out-dir. A folder
    stands for all takes in it and below it; --out-dir then has the same tree.
    """
    with stages_shown(options):
        from mocapclean.cli.actions import fill

        return fill.work(**options)
