"""What is asked about a method by its name, before it runs."""

from mocapclean.errors import UsageError
from mocapclean.solvers import SOLVERS


def require_method(name: str, *others: str) -> None:
    """Raise UsageError unless a name is that of a method, or one of the others that are allowed."""
    if name not in SOLVERS and name not in others:
        known = ", ".join((*SOLVERS, *SOLVERS.installed(), *others))
        raise UsageError(f"a method must be one of {known}. Got {name!r}.")


def needs_dictionary(name: str) -> bool:
    """Whether a method needs a trained dictionary."""
    return SOLVERS[name].TRAITS.needs_dictionary
