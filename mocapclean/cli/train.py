"""``mocapclean train``: learn a dictionary of a body's poses from clean takes."""

from dataclasses import fields
from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import (
    EXCLUDE,
    FILE,
    OUTPUT,
    RATE,
    SKELETON,
    TAKES,
    UNIT,
    Command,
    examples,
    overwriting,
    seed,
    verbose,
)
from mocapclean.dictionaries.training_parameters import Params
from mocapclean.parameters import about


def _training(command: Any) -> Any:
    """Return the command with one option for every training parameter."""
    for field in reversed(fields(Params)):
        meaning = about(Params, field.name)
        name = "--" + field.name.replace("_", "-")
        text = f"{meaning.text[0].upper()}{meaning.text[1:]} ({meaning.symbol})."
        command = click.option(name, type=type(field.default), default=field.default, show_default=True, help=text)(
            command
        )
    return command


@click.command("train", cls=Command, epilog=examples("mocapclean train captures/ -o studio.dict.npz --exclude 'Prop*'"))
@click.argument("files", nargs=-1, required=True, type=FILE, metavar=TAKES)
@click.option("-o", "--output", type=FILE, required=True, help=f"{OUTPUT}a dictionary, such as walk.dict.npz.")
@click.option("--body-parts", type=FILE, help="YAML: marker names under TO, LA, RA, LL, RL and the frame.")
@EXCLUDE
@SKELETON
@RATE
@UNIT
@seed()
@overwriting(default=False)
@_training
@verbose()
@guarded
def command(**options: Any) -> int:
    """Learn a dictionary for llc and srmmp from clean takes (.c3d, .bvh, .amc, .trc, .csv, .tsv).

    A folder stands for all takes in it and below it. All takes must show the same body, with the same markers and rate.
    Only trusted samples are used.
    """
    from mocapclean.cli.actions import train

    return train.work(**options)
