"""The action of ``mocapclean train``: learn a dictionary of a body's poses from clean takes."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from tqdm import tqdm

from mocapclean import formats
from mocapclean.cli.actions.arguments import millimetres, names, takes_in
from mocapclean.dictionaries.body_parts import BodyParts, from_mapping, known_parts
from mocapclean.dictionaries.training import n_steps, train
from mocapclean.dictionaries.training_parameters import Params
from mocapclean.errors import UsageError
from mocapclean.files import check_output, new_file
from mocapclean.parameters import faults
from mocapclean.take import Take
from mocapclean.take.names import matching_columns


def work(
    files: tuple[Path, ...],
    output: Path,
    body_parts: Path | None,
    exclude: tuple[str, ...],
    skeleton: Path | None,
    rate: float | None,
    unit: str | None,
    seed: int,
    overwrite: bool,
    **options: Any,
) -> int:
    """Learn a dictionary, and write it; return the exit code."""
    if refused := faults(Params, options):
        name, fault, value = refused[0]
        raise UsageError(f"--{name.replace('_', '-')}: {fault}. Got {value!r}.")
    params = Params(**options)
    captures = takes_in(files)
    if output.suffix.lower() != ".npz":
        raise UsageError(f"{output}: the name of a dictionary must end in .npz.")
    for kept in (*captures, skeleton, body_parts):
        check_output(output, kept, overwrite)
    takes = [
        _without(formats.read(f, **_options(f, skeleton, rate, unit)), names(exclude))
        for f in tqdm(captures, "read", disable=None)
    ]
    parts = _read_parts(body_parts) if body_parts else known_parts(takes[0].markers)
    with tqdm(total=n_steps(parts, params), desc="train", disable=None) as bar:
        dictionary = train(takes, parts, params, seed, bar.update)
    with new_file(output) as part:
        dictionary.save(part)
    sizes = ", ".join(f"{name} {len(atoms)}" for name, atoms in dictionary.atoms.items())
    click.echo(
        f"{output}: {len(takes)} takes, {dictionary.parameters['frames']} frames; atoms: {sizes}; "
        f"{len(dictionary.poses)} poses"
    )
    return 0


def _options(path: Path, skeleton: Path | None, rate: float | None, unit: str | None) -> dict[str, Any]:
    """Return the options with which a take is read."""
    return {
        "skeleton": skeleton if formats.needs_skeleton(path) else None,
        "rate": rate,
        "unit": millimetres(unit) if unit else None,
    }


def _without(take: Take, exclude: Sequence[str]) -> Take:
    """Return a take without the markers that some patterns match."""
    left_out = {column for pattern in exclude for column in matching_columns(pattern, take.markers)}
    kept = [column for column in range(len(take.markers)) if column not in left_out]
    return replace(take.select(np.array(kept, dtype=np.intp)), origin=take.origin)


def _read_parts(path: Path) -> BodyParts:
    """Return the body parts in a YAML file; raise UsageError if it is unreadable."""
    try:
        return from_mapping(YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8")), str(path))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}.") from None
    except (YAMLError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: not valid YAML: {str(error).splitlines()[0]}.") from None
