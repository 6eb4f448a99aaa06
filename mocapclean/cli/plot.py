"""``mocapclean plot``: figures of takes as PNG, SVG or PDF; the takes are not changed."""

from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE, reading
from mocapclean.cli.stages import stages_shown


class _Frames(click.ParamType[tuple[int, int]]):
    """The type of ``--frames``: first-last."""

    name = "first-last"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """Return the first and the last frame."""
        first, dash, last = str(value).partition("-")
        if not (dash and first.isdecimal() and last.isdecimal() and int(first) <= int(last)):
            self.fail(f"frames must be first-last, such as 100-250. Got {value!r}.", param, ctx)
        return int(first), int(last)


@click.command("plot")
@click.argument("files", nargs=-1, required=True, type=FILE)
@click.option("-o", "--output", type=FILE, required=True, help="The figure to write: .png, .svg or .pdf.")
@click.option("--marker", metavar="NAME", help="The curves of this marker before and after, with the 90 % band.")
@click.option("--bones", is_flag=True, help="The lengths of the worst bones over time, before and after.")
@click.option("--frames", type=_Frames(), help="Only these frames of the curves.")
@click.option("--method", help="How to fill, for the curves and bones: a name from 'mocapclean methods'.")
@click.option("--overwrite/--no-overwrite", default=None, help="Replace an existing figure.")
@reading
@guarded
def command(**options: Any) -> int:
    """Draw the map of the samples of FILES (.c3d, .bvh, .amc): what is missing, distrusted and suspicious, and when.

    Several takes share one sheet. With --marker or --bones one take is filled as 'mocapclean fill' would, in a
    temporary folder, and its curves are drawn before and after.
    """
    with stages_shown(options):
        from mocapclean.cli.work import plot

        return plot.work(**options)
