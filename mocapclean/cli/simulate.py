"""``mocapclean simulate``: write simulated takes with gaps, faults and the truth, in all three formats."""

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from mocapclean.arrays import Floats
from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE
from mocapclean.config.settings import MILLIMETRES
from mocapclean.errors import UsageError
from mocapclean.formats import amc, bvh, c3d, check_output, new_file
from mocapclean.simulate import FAULTS, MOTIONS, Injected, Performance, hide, inject, lose_channels, occlude, perform


@click.command("simulate")
@click.option("--out-dir", type=FILE, required=True, help="Folder for the takes; made if it does not exist.")
@click.option("--motion", multiple=True, type=click.Choice(list(MOTIONS)), help="Simulate this motion (default: all).")
@click.option("--seconds", type=float, default=10.0, show_default=True, help="Length of each take.")
@click.option("--rate", type=float, default=120.0, show_default=True, help="Frames per second.")
@click.option("--missing", type=float, default=0.05, show_default=True, help="Share of marker samples to hide.")
@click.option("--faults", metavar="KIND,...", help=f"Add faults to the markers: all, or some of {', '.join(FAULTS)}.")
@click.option(
    "--fault-rate", type=float, default=1.0, show_default=True, help="Events of each kind per 10,000 samples."
)
@click.option(
    "--fault-size", type=float, default=1.0, show_default=True, help="1: spikes of 20 mm; 2: spikes of 40 mm."
)
@click.option("--stated-as", type=click.Choice(list(MILLIMETRES)), help="Store markers in this unit, but state mm.")
@click.option("--seed", type=int, default=0, show_default=True, help="The same seed gives the same files.")
@click.option("--overwrite", is_flag=True, help="Replace existing files.")
@guarded
def command(
    out_dir: Path,
    motion: tuple[str, ...],
    seconds: float,
    rate: float,
    missing: float,
    faults: str | None,
    fault_rate: float,
    fault_size: float,
    stated_as: str | None,
    seed: int,
    overwrite: bool,
) -> int:
    """Write simulated takes with gaps (NAME) and complete (NAME_truth), as C3D, BVH and AMC with ASF.

    With --faults the markers of NAME.c3d have faults as well, listed in NAME_faults.csv as kind,marker,first,last.
    """
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out_dir}: the folder cannot be made: {error.strerror}.") from None
    kinds = [] if faults in (None, "all") else [kind.strip() for kind in str(faults).split(",") if kind.strip()]
    for name in motion or MOTIONS:
        performance = perform(name, seconds, rate, seed)
        # Faults and gaps are drawn from generators of their own, so that --faults leaves the gaps as they are.
        injected = inject(
            performance.markers, np.random.default_rng([seed, 2]), kinds, fault_rate if faults else 0.0, fault_size
        )
        if stated_as:
            positions = injected.take.positions / MILLIMETRES[stated_as]
            injected = replace(injected, take=replace(injected.take, positions=positions))
        rng = np.random.default_rng([seed, 1])
        for path in _write(performance, injected, out_dir, missing, rng, overwrite, with_faults=bool(faults)):
            click.echo(path)
    return 0


def _write(
    performance: Performance,
    injected: Injected,
    folder: Path,
    missing: float,
    rng: np.random.Generator,
    overwrite: bool,
    with_faults: bool,
) -> list[Path]:
    """Write all files of a performance into a folder, and return their paths."""
    name, rate = performance.name, performance.rate
    with_gaps = hide(injected.take, occlude(performance.markers, rng, missing))
    bvh_with_gaps = lose_channels(performance.bvh, performance.bvh_poses, rng)
    asf_with_gaps = lose_channels(performance.asf, performance.asf_poses, rng)
    asf = folder / f"{name}.asf"

    def motion(poses: Floats) -> Callable[[Path], None]:
        return lambda part: amc.create(performance.asf, poses, part, asf)

    writers: dict[str, Callable[[Path], None]] = {
        f"{name}_truth.c3d": lambda part: c3d.create(performance.markers, part),
        f"{name}.c3d": lambda part: c3d.create(with_gaps, part),
        f"{name}_truth.bvh": lambda part: bvh.create(performance.bvh, performance.bvh_poses, rate, part),
        f"{name}.bvh": lambda part: bvh.create(performance.bvh, bvh_with_gaps, rate, part),
        f"{name}_01_truth.amc": motion(performance.asf_poses),
        f"{name}_01.amc": motion(asf_with_gaps),
    }
    if with_faults:
        writers[f"{name}_faults.csv"] = lambda part: _write_faults(injected, part)
    paths = [folder / file for file in writers]
    for path in (asf, *paths):
        check_output(path, None, overwrite)
    for path, write in zip(paths, writers.values(), strict=True):
        with new_file(path) as part:
            write(part)
    return [asf, *paths]


def _write_faults(injected: Injected, path: Path) -> None:
    """Write the faults as CSV, one line per marker of each fault, with the file's frame numbers, inclusive."""
    take = injected.take
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("kind", "marker", "first", "last"))
        for event in injected.events:
            for marker in event.markers:
                writer.writerow((event.kind, take.markers[marker], *take.numbers(event.start, event.stop)))
