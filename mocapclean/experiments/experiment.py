"""The declaration of an experiment in its module."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from mocapclean.experiments.results import Figure, Results, Table
from mocapclean.experiments.trials import Request, Trial


def _no_notes(request: Request) -> list[str]:
    return []


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """An experiment.

    reference: of its paper. measures: columns of its results. trials: of a request. tables, figures: of its results.
    sequences: the paper's takes, looked for in a folder if no file is named. gappy: captures with natural gaps to put
    into the takes, looked for in a folder if ``--mask-from`` names none; empty if they are of no use. needs_captures:
    whether it needs takes. quick_frames: first frames of each take that ``--quick`` keeps; None for all. infers_unit:
    whether the unit of a BVH is inferred from the body unless the user gives it; the papers' takes are in centimetres.
    notes: lines printed above the tables.
    """

    reference: str
    measures: tuple[str, ...]
    trials: Callable[[Request], Sequence[Trial]]
    tables: Callable[[Results], Sequence[Table]]
    figures: Callable[[Results], Sequence[Figure]]
    sequences: tuple[str, ...] = ()
    gappy: tuple[str, ...] = ()
    needs_captures: bool = True
    quick_frames: int | None = None
    infers_unit: bool = False
    notes: Callable[[Request], Sequence[str]] = _no_notes


class ExperimentModule(Protocol):
    """The module of an experiment."""

    EXPERIMENT: Experiment
