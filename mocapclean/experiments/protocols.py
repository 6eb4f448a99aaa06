"""The registry of experiments: one module each, which declares its ``EXPERIMENT``."""

from typing import TYPE_CHECKING

from mocapclean.registry import Modules

if TYPE_CHECKING:
    from mocapclean.experiments.experiment import ExperimentModule

EXPERIMENTS: "Modules[ExperimentModule]" = Modules(
    "mocapclean.experiments",
    ("tan2015", "hu2017", "imamura2018", "wang2016", "markers", "compare", "occlusion", "trust", "harm", "skeletons"),
)
