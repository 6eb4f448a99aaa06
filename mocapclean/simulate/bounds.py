"""Checks of the arguments of simulations."""

from numbers import Integral

from mocapclean.errors import UsageError


def require_between(what: str, value: float, low: float, high: float) -> None:
    """Raise UsageError unless low <= value <= high; ``what`` begins the message."""
    if not low <= value <= high:
        raise UsageError(f"{what} must be between {low:g} and {high:g}. Got {value}.")


def require_whole(what: str, value: int, low: int, high: int | None = None) -> None:
    """Raise UsageError unless value is a whole number, at least low and at most high; ``what`` begins the message."""
    if not isinstance(value, Integral) or value < low or (high is not None and value > high):
        rule = f"a whole number of at least {low}" if high is None else f"a whole number between {low} and {high}"
        raise UsageError(f"{what} must be {rule}. Got {value}.")
