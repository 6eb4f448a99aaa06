"""Rows of results for the tests of experiments."""

from mocapclean.experiments.results import Row


def result_row(take: str, method: str, error: float, pattern: str = "1x30", **values: float) -> Row:
    """Return the row of a method with default parameters and an RMSE (mm), for a take, a pattern and seed 0."""
    return Row(
        take=take,
        method=method,
        variant="",
        parameters="{}",
        cell={"pattern": pattern},
        seed=0,
        values={"rmse": error, **values},
        series=dict,
    )
