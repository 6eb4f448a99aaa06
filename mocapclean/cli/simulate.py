"""``mocapclean simulate``: write simulated takes with gaps, faults and the truth, in all three formats."""

from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE, Command, examples, overwriting, seed, verbose
from mocapclean.simulate import FAULTS, MOTIONS
from mocapclean.units import MILLIMETRES


@click.command(
    "simulate",
    cls=Command,
    epilog=examples(
        "mocapclean simulate --out-dir demo/", "mocapclean simulate --out-dir demo/ --motion walk --faults all"
    ),
)
@click.option("--out-dir", type=FILE, required=True, help="Folder for the takes; made if it does not exist.")
@click.option("--motion", multiple=True, type=click.Choice(list(MOTIONS)), help="Simulate this motion (default: all).")
@click.option("--seconds", type=float, default=10.0, show_default=True, help="Length of each take.")
@click.option("--rate", type=float, default=120.0, show_default=True, help="Frames per second.")
@click.option(
    "--occlusion",
    type=click.Choice(["random", "cameras"]),
    default="random",
    show_default=True,
    help="Hide marker samples in random gaps, or those that simulated cameras do not see past the body.",
)
@click.option("--missing", type=float, help="Share of marker samples to hide in random gaps (default: 0.05).")
@click.option("--cameras", type=int, help="Number of cameras around the figure (default: 8).")
@click.option(
    "--prop",
    "props",
    multiple=True,
    metavar="KIND:NUMBERS",
    help="Thing that hides markers from the cameras, in mm: box:x,y,z,x,y,z, cylinder:x,y,z,x,y,z,r or capsule:...",
)
@click.option("--faults", metavar="KIND,...", help=f"Add faults to the markers: all, or some of {', '.join(FAULTS)}.")
@click.option(
    "--fault-rate", type=float, default=1.0, show_default=True, help="Events of each kind per 10,000 samples."
)
@click.option(
    "--fault-size",
    type=float,
    default=1.0,
    show_default=True,
    help="Size of faults; 1: spikes of 20 mm; 2: 40 mm.",
)
@click.option("--stated-as", type=click.Choice(list(MILLIMETRES)), help="Store markers in this unit, but state mm.")
@seed()
@overwriting(default=False)
@verbose()
@guarded
def command(**options: Any) -> int:
    """Write simulated takes with gaps (NAME) and complete (NAME_truth), as C3D, BVH and AMC with ASF.

    With --faults the markers of NAME.c3d have faults as well, listed in NAME_faults.csv as kind,marker,first,last.
    """
    from mocapclean.cli.actions import simulate

    return simulate.work(**options)
