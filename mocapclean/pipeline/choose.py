"""Which method fills a take: the one that is asked for, or the one that does best on hidden samples of the take."""

from collections.abc import Callable
from functools import partial
from typing import Any

from mocapclean.arrays import Bools
from mocapclean.config.settings import Settings
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.errors import MocapcleanError, SolverError
from mocapclean.evaluation import self_check
from mocapclean.evaluation.self_check import HiddenGaps, SelfCheck
from mocapclean.pipeline.outcome import Candidate, Choice
from mocapclean.solvers import ERROR_BARS, GAPWISE, SOLVERS
from mocapclean.take import Solution, Take


def solver(method: str, settings: Settings, library: Dictionary | None) -> Callable[[Take, Bools], Solution]:
    """A method with its parameters from the settings; see ``prepared``."""
    return prepared(method, getattr(settings.methods, method), library)


def prepared(method: str, params: Any, library: Dictionary | None = None) -> Callable[[Take, Bools], Solution]:
    """A method with its parameters and dictionary, asked for the gaps of samples (F, M)."""
    solve = partial(SOLVERS[method].solve, params=params, library=library)
    if method in GAPWISE:
        return lambda take, wanted: solve(take, wanted=wanted)
    return lambda take, wanted: solve(take)


def choose(take: Take, wanted: Bools, settings: Settings, library: Dictionary | None) -> tuple[Choice, SelfCheck]:
    """Let every candidate of ``auto.methods`` fill the same hidden samples; what was chosen, and its self-check.

    The least 3D error wins among the candidates that fill the most of them; where nothing can be hidden, the first one
    that can be used. Raises SolverError when there is none.
    """
    checks: dict[str, SelfCheck] = {}
    left_out: dict[str, str] = {}
    for method in settings.auto.methods:
        try:
            checks[method] = _check(method, take, wanted, settings, library)
        except MocapcleanError as fault:
            left_out[method] = str(fault)
    if not checks:
        reasons = " ".join(f"{method}: {reason}" for method, reason in left_out.items())
        raise SolverError(f"none of the methods that auto may choose can be used. {reasons}")
    method = min(checks, key=lambda name: _rank(checks[name].total))
    nothing = checks[method].because
    choice = Choice(
        method=method,
        because=f"the first, as {nothing}" if nothing else "the least 3D error of those that fill the most",
        candidates=tuple(
            Candidate(
                method=name,
                total=checks[name].total if name in checks else HiddenGaps(),
                left_out=left_out.get(name, ""),
            )
            for name in settings.auto.methods
        ),
    )
    return choice, checks[method]


def _check(method: str, take: Take, wanted: Bools, settings: Settings, library: Dictionary | None) -> SelfCheck:
    if settings.max_error is not None and method not in ERROR_BARS:
        raise SolverError("it gives no error bars, which max_error needs.")
    solve = solver(method, settings, library)
    found = self_check.check(take, wanted, solve, settings.hiding)
    if found.because and not take.trusted.all():
        solve(take, wanted)  # raises where the method cannot be used
    return found


def _rank(total: HiddenGaps) -> tuple[int, float]:
    """Hidden samples left, then the error: the least is the best."""
    if total.error is None:
        return total.samples, 0.0
    return total.samples - total.error.samples, total.error.rmse_3d
