"""``mocapclean simulate``: takes with known truth and gaps, in all three formats."""

from collections.abc import Callable
from pathlib import Path

import click
import numpy as np

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE
from mocapclean.errors import UsageError
from mocapclean.formats import amc, bvh, c3d, check_output, new_file
from mocapclean.records import Floats
from mocapclean.simulate import MOTIONS, Performance, hide, lose_channels, occlude, perform


@click.command("simulate")
@click.option("--out-dir", type=FILE, required=True, help="Folder for the takes; made if it is not there.")
@click.option("--motion", multiple=True, type=click.Choice(list(MOTIONS)), help="Which motions (default: all).")
@click.option("--seconds", type=float, default=10.0, show_default=True, help="Length of each take.")
@click.option("--rate", type=float, default=120.0, show_default=True, help="Frames per second.")
@click.option("--missing", type=float, default=0.05, show_default=True, help="Share of marker samples that are hidden.")
@click.option("--seed", type=int, default=0, show_default=True, help="The same seed gives the same files.")
@click.option("--overwrite", is_flag=True, help="Replace files that exist.")
@guarded
def command(
    out_dir: Path, motion: tuple[str, ...], seconds: float, rate: float, missing: float, seed: int, overwrite: bool
) -> int:
    """Write simulated takes, each with gaps and as the whole truth (NAME_truth), as C3D, BVH and AMC with ASF."""
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise UsageError(f"{out_dir}: the folder cannot be made: {fault.strerror}.") from None
    for name in motion or MOTIONS:
        performance = perform(name, seconds, rate, seed)
        for path in _write(performance, out_dir, missing, np.random.default_rng([seed, 1]), overwrite):
            click.echo(path)
    return 0


def _write(
    performance: Performance, folder: Path, missing: float, rng: np.random.Generator, overwrite: bool
) -> list[Path]:
    name, rate = performance.name, performance.rate
    broken = hide(performance.markers, occlude(performance.markers, rng, missing))
    bvh_broken = lose_channels(performance.bvh, performance.bvh_poses, rng)
    asf_broken = lose_channels(performance.asf, performance.asf_poses, rng)
    asf = folder / f"{name}.asf"

    def motion(poses: Floats) -> Callable[[Path], None]:
        return lambda part: amc.create(performance.asf, poses, part, asf)

    writers: dict[str, Callable[[Path], None]] = {
        f"{name}_truth.c3d": lambda part: c3d.create(performance.markers, part),
        f"{name}.c3d": lambda part: c3d.create(broken, part),
        f"{name}_truth.bvh": lambda part: bvh.create(performance.bvh, performance.bvh_poses, rate, part),
        f"{name}.bvh": lambda part: bvh.create(performance.bvh, bvh_broken, rate, part),
        f"{name}_01_truth.amc": motion(performance.asf_poses),
        f"{name}_01.amc": motion(asf_broken),
    }
    paths = [folder / file for file in writers]
    for path in (asf, *paths):
        check_output(path, None, overwrite)
    for path, write in zip(paths, writers.values(), strict=True):
        with new_file(path) as part:
            write(part)
    return [asf, *paths]
