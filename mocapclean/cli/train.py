"""``mocapclean train``: learn a dictionary of a body's poses from clean takes."""

from dataclasses import fields
from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE
from mocapclean.dictionaries.training_parameters import Params
from mocapclean.parameters import about


def _training(command: Any) -> Any:
    """Return the command with one option for every training parameter."""
    for field in reversed(fields(Params)):
        meaning = about(Params, field.name)
        name = "--" + field.name.replace("_", "-")
        text = f"{meaning.text} ({meaning.symbol})."
        command = click.option(name, type=type(field.default), default=field.default, show_default=True, help=text)(
            command
        )
    return command


@click.command("train")
@click.argument("inputs", nargs=-1, required=True, type=FILE, metavar="FOLDER|FILES...")
@click.option("-o", "--output", type=FILE, required=True, help="The dictionary to write, such as walk.dict.npz.")
@click.option("--body-parts", type=FILE, help="YAML: marker names under TO, LA, RA, LL, RL and the frame.")
@click.option("--exclude", multiple=True, metavar="NAME", help="Leave this marker out.")
@click.option("--skeleton", type=FILE, help="The .asf of the .amc files, if it is in another folder.")
@click.option("--rate", type=float, help="Frames per second, for files without a rate (AMC: 120).")
@click.option(
    "--unit", default="cm", show_default=True, help="Unit of length of BVH files: mm, cm, m, in, or mm per unit."
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="The same seed gives the same dictionary."
)
@click.option("--overwrite", is_flag=True, help="Replace an existing dictionary.")
@_training
@guarded
def command(**options: Any) -> int:
    """Learn a dictionary for llc and srmmp from clean takes (.c3d, .bvh, .amc): FILES, or all takes of a FOLDER.

    All takes must show the same body, with the same markers and rate. Only trusted samples are used.
    """
    from mocapclean.cli.work import train

    return train.work(**options)
