"""``mocapclean simulate``: takes with known truth and gaps, in all three formats, and with known faults."""

import csv
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from mocapclean import formats
from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE
from mocapclean.config.settings import MILLIMETRES
from mocapclean.errors import UsageError
from mocapclean.files import check_output, new_file
from mocapclean.simulate import FAULTS, MOTIONS, Injected, Performance, hide, inject, lose_channels, occlude, perform
from mocapclean.take import Take
from mocapclean.take.posed import posed_take


@click.command("simulate")
@click.option("--out-dir", type=FILE, required=True, help="Folder for the takes; made if it is not there.")
@click.option("--motion", multiple=True, type=click.Choice(list(MOTIONS)), help="Which motions (default: all).")
@click.option("--seconds", type=float, default=10.0, show_default=True, help="Length of each take.")
@click.option("--rate", type=float, default=120.0, show_default=True, help="Frames per second.")
@click.option("--missing", type=float, default=0.05, show_default=True, help="Share of marker samples that are hidden.")
@click.option("--faults", metavar="KIND,...", help=f"Put faults into the markers: all, or some of {', '.join(FAULTS)}.")
@click.option("--fault-rate", type=float, default=1.0, show_default=True, help="Events of a kind for 10,000 samples.")
@click.option("--fault-size", type=float, default=1.0, show_default=True, help="1: spikes of 20 mm; 2: twice as large.")
@click.option("--stated-as", type=click.Choice(list(MILLIMETRES)), help="Store markers in this unit, stated as mm.")
@click.option("--seed", type=int, default=0, show_default=True, help="The same seed gives the same files.")
@click.option("--overwrite", is_flag=True, help="Replace files that exist.")
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
    """Write simulated takes, each with gaps and as the whole truth (NAME_truth), as C3D, BVH and AMC with ASF.

    With --faults the markers of NAME.c3d have faults as well, and NAME_faults.csv lists them: kind,marker,first,last.
    """
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise UsageError(f"{out_dir}: the folder cannot be made: {fault.strerror}.") from None
    chosen = [] if faults in (None, "all") else [kind.strip() for kind in str(faults).split(",") if kind.strip()]
    for name in motion or MOTIONS:
        performance = perform(name, seconds, rate, seed)
        injected = inject(
            performance.markers, np.random.default_rng([seed, 2]), chosen, fault_rate if faults else 0.0, fault_size
        )
        if stated_as:
            positions = injected.take.positions / MILLIMETRES[stated_as]
            injected = replace(injected, take=replace(injected.take, positions=positions))
        rng = np.random.default_rng([seed, 1])
        for path in _write(performance, injected, out_dir, missing, rng, overwrite, with_list=bool(faults)):
            click.echo(path)
    return 0


def _write(
    performance: Performance,
    injected: Injected,
    folder: Path,
    missing: float,
    rng: np.random.Generator,
    overwrite: bool,
    with_list: bool,
) -> list[Path]:
    """Write the files of one motion; return their paths."""
    name = performance.name
    takes = _takes(performance, injected, missing, rng)
    skeleton = folder / f"{name}.asf"
    faults = folder / f"{name}_faults.csv"
    paths = [skeleton, *(folder / file for file in takes), *([faults] if with_list else [])]
    for path in paths:
        check_output(path, None, overwrite)
    for file, take in takes.items():
        formats.write(take, folder / file, overwrite=overwrite)
    if with_list:
        with new_file(faults) as part:
            _list(injected, part)
    return paths


def _takes(performance: Performance, injected: Injected, missing: float, rng: np.random.Generator) -> dict[str, Take]:
    """Return the takes of one motion by file name: the truth and its broken copy, in each format."""
    name, rate = performance.name, performance.rate
    broken = hide(injected.take, occlude(performance.markers, rng, missing))
    bvh_broken = lose_channels(performance.bvh, performance.bvh_poses, rng)
    asf_broken = lose_channels(performance.asf, performance.asf_poses, rng)
    return {
        f"{name}_truth.c3d": performance.markers,
        f"{name}.c3d": broken,
        f"{name}_truth.bvh": posed_take(performance.bvh, performance.bvh_poses, rate),
        f"{name}.bvh": posed_take(performance.bvh, bvh_broken, rate),
        f"{name}_01_truth.amc": posed_take(performance.asf, performance.asf_poses, rate),
        f"{name}_01.amc": posed_take(performance.asf, asf_broken, rate),
    }


def _list(injected: Injected, path: Path) -> None:
    """Write the faults: a line for each marker of each event, in the file's own frame numbers, inclusive."""
    take = injected.take
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("kind", "marker", "first", "last"))
        for event in injected.events:
            for marker in event.markers:
                writer.writerow((event.kind, take.markers[marker], *take.numbers(event.start, event.stop)))
