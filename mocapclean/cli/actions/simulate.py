"""The action of ``mocapclean simulate``: write simulated takes with gaps, faults and the truth, as C3D, BVH and AMC."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import click
import numpy as np

from mocapclean import formats
from mocapclean.arrays import Bools
from mocapclean.errors import UsageError
from mocapclean.files import check_output, new_file
from mocapclean.simulate import (
    MOTIONS,
    N_CAMERAS,
    Injected,
    Performance,
    hide,
    inject,
    lose_channels,
    occlude,
    occlude_by_cameras,
    perform,
    prop,
)
from mocapclean.take import Take
from mocapclean.take.posed import posed_take
from mocapclean.units import MILLIMETRES


def work(
    out_dir: Path,
    motion: tuple[str, ...],
    seconds: float,
    rate: float,
    occlusion: str,
    missing: float | None,
    cameras: int | None,
    props: tuple[str, ...],
    faults: str | None,
    fault_rate: float,
    fault_size: float,
    stated_as: str | None,
    seed: int,
    overwrite: bool,
) -> int:
    """Write simulated takes and print their paths; return the exit code."""
    lost = _loss(occlusion, missing, cameras, props)
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
        for path in _write(performance, injected, out_dir, lost, rng, overwrite, with_faults=bool(faults)):
            click.echo(path)
    return 0


Loss = Callable[[Take, np.random.Generator], Bools]
"""A function of a take and random numbers, which returns the samples (F, M) that are lost."""


def _loss(occlusion: str, missing: float | None, cameras: int | None, props: Sequence[str]) -> Loss:
    """Return the way in which samples are lost; raise UsageError for an option of the other way."""
    if occlusion == "random":
        if cameras is not None or props:
            raise UsageError("--cameras and --prop must be left out without --occlusion cameras.")
        return partial(occlude, share=0.05 if missing is None else missing)
    if missing is not None:
        raise UsageError("--missing must be left out with --occlusion cameras: the share follows from the cameras.")
    number = N_CAMERAS if cameras is None else cameras
    return partial(occlude_by_cameras, n_cameras=number, props=[prop(text) for text in props])


def _write(
    performance: Performance,
    injected: Injected,
    folder: Path,
    lost: Loss,
    rng: np.random.Generator,
    overwrite: bool,
    with_faults: bool,
) -> list[Path]:
    """Write the files of one motion; return their paths."""
    name = performance.name
    takes = _takes(performance, injected, lost, rng)
    skeleton = folder / f"{name}.asf"
    faults = folder / f"{name}_faults.csv"
    paths = [skeleton, *(folder / file for file in takes), *([faults] if with_faults else [])]
    for path in paths:
        check_output(path, None, overwrite)
    for file, take in takes.items():
        formats.write(take, folder / file, overwrite=overwrite)
    if with_faults:
        with new_file(faults) as part:
            _write_faults(injected, part)
    return paths


def _takes(performance: Performance, injected: Injected, lost: Loss, rng: np.random.Generator) -> dict[str, Take]:
    """Return the takes of one motion by file name: the complete take and one with gaps, in each format."""
    name, rate = performance.name, performance.rate
    with_gaps = hide(injected.take, lost(performance.markers, rng))
    bvh_with_gaps = lose_channels(performance.bvh, performance.bvh_poses, rng)
    asf_with_gaps = lose_channels(performance.asf, performance.asf_poses, rng)
    return {
        f"{name}_truth.c3d": performance.markers,
        f"{name}.c3d": with_gaps,
        f"{name}_truth.bvh": posed_take(performance.bvh, performance.bvh_poses, rate),
        f"{name}.bvh": posed_take(performance.bvh, bvh_with_gaps, rate),
        f"{name}_01_truth.amc": posed_take(performance.asf, performance.asf_poses, rate),
        f"{name}_01.amc": posed_take(performance.asf, asf_with_gaps, rate),
    }


def _write_faults(injected: Injected, path: Path) -> None:
    """Write the faults: a line for each marker of each event, in the file's own frame numbers, inclusive."""
    take = injected.take
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("kind", "marker", "first", "last"))
        for event in injected.events:
            for marker in event.markers:
                writer.writerow((event.kind, take.markers[marker], *take.numbers(event.start, event.stop)))
