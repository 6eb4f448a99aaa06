"""The registry of experiments."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mocapclean.experiments import compare, harm, hu2017, imamura2018, markers, tan2015, trust, wang2016
from mocapclean.experiments.results import Figure, Results, Table
from mocapclean.experiments.trials import Request, Trial


def _no_notes(request: Request) -> list[str]:
    return []


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """An experiment.

    reference: of its paper. measures: columns of its results. trials: of a request. tables, figures: of its results.
    sequences: the paper's takes, looked for in a folder if no file is named. needs_captures: whether it needs takes.
    quick_frames: first frames of each take that ``--quick`` keeps; None for all. notes: lines printed above the tables.
    """

    reference: str
    measures: tuple[str, ...]
    trials: Callable[[Request], Sequence[Trial]]
    tables: Callable[[Results], Sequence[Table]]
    figures: Callable[[Results], Sequence[Figure]]
    sequences: tuple[str, ...] = ()
    needs_captures: bool = True
    quick_frames: int | None = None
    notes: Callable[[Request], Sequence[str]] = _no_notes


EXPERIMENTS: dict[str, Experiment] = {
    "tan2015": Experiment(
        reference="C.-H. Tan, J. Hou, L.-P. Chau, 2015, doi:10.1007/s00371-014-1031-5",
        measures=tan2015.MEASURES,
        trials=tan2015.trials,
        tables=tan2015.tables,
        figures=tan2015.figures,
        sequences=("14_01", "85_02", "143_04", "49_02", "135_02", "135_11", "61_05", "88_04"),
    ),
    "hu2017": Experiment(
        reference="W. Hu, Z. Wang, S. Liu, X. Yang, G. Yu, J. J. Zhang, 2017, IEEE Signal Process. Lett.",
        measures=hu2017.MEASURES,
        trials=hu2017.trials,
        tables=hu2017.tables,
        figures=hu2017.figures,
        quick_frames=hu2017.QUICK_FRAMES,
        sequences=("05_13", "12_02", "49_02", "13_13", "10_01", "13_17"),
        needs_captures=False,
    ),
    "imamura2018": Experiment(
        reference="R. Imamura, M. Okuda, 2018",
        measures=imamura2018.MEASURES,
        trials=imamura2018.trials,
        tables=imamura2018.tables,
        figures=imamura2018.figures,
        quick_frames=imamura2018.QUICK_FRAMES,
        sequences=("13_13", "10_01", "13_17"),
    ),
    "wang2016": Experiment(
        reference="Z. Wang, Y. Feng, S. Liu, J. Xiao, X. Yang, J. J. Zhang, 2016",
        measures=wang2016.MEASURES,
        trials=wang2016.trials,
        tables=wang2016.tables,
        figures=wang2016.figures,
        quick_frames=wang2016.QUICK_FRAMES,
        notes=wang2016.notes,
    ),
    "markers": Experiment(
        reference="gaps of known size in real labelled markers, mocapclean.simulate.single_gaps",
        measures=markers.MEASURES,
        trials=markers.trials,
        tables=markers.tables,
        figures=markers.figures,
        quick_frames=markers.QUICK_FRAMES,
        notes=markers.notes,
    ),
    "compare": Experiment(
        reference="natural-looking gaps, mocapclean.simulate.occlude",
        measures=compare.MEASURES,
        trials=compare.trials,
        tables=compare.tables,
        figures=compare.figures,
        quick_frames=compare.QUICK_FRAMES,
    ),
    "trust": Experiment(
        reference="faults of known place, kind and size, mocapclean.simulate.inject",
        measures=trust.MEASURES,
        trials=trust.trials,
        tables=trust.tables,
        figures=trust.figures,
        quick_frames=trust.QUICK_FRAMES,
    ),
    "harm": Experiment(
        reference="right samples in unusual situations, mocapclean.simulate.vary, and hidden gaps",
        measures=harm.MEASURES,
        trials=harm.trials,
        tables=harm.tables,
        figures=harm.figures,
        quick_frames=harm.QUICK_FRAMES,
        notes=harm.notes,
    ),
}
