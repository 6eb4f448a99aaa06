"""The method that fills a take: the one in the settings, or the best of several on hidden samples of the take."""

from collections.abc import Callable

from mocapclean.arrays import Bools
from mocapclean.config.settings import Settings
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.errors import MocapcleanError, SolverError
from mocapclean.evaluation import self_check
from mocapclean.evaluation.self_check import Check, SelfCheck
from mocapclean.pipeline.outcome import Candidate, Choice
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method
from mocapclean.take import Solution, Take


def solver(method: str, settings: Settings, dictionary: Dictionary | None) -> Callable[[Take, Bools], Solution]:
    """Return a method with its parameters of the settings, as a function of a take and the wanted samples (F, M)."""
    params = getattr(settings.methods, method)
    return lambda take, wanted: run_method(method, take, params, wanted=wanted, dictionary=dictionary)


def choose(take: Take, wanted: Bools, settings: Settings, dictionary: Dictionary | None) -> tuple[Choice, SelfCheck]:
    """Fill the same hidden samples with every candidate of ``auto.methods``; return the choice and its self-check.

    The least 3D error wins among the candidates that fill the most of them; where nothing can be hidden, the first one
    that can be used. Raises SolverError when there is none.
    """
    checks: dict[str, SelfCheck] = {}
    left_out: dict[str, str] = {}
    for method in settings.auto.methods:
        try:
            checks[method] = _check(method, take, wanted, settings, dictionary)
        except MocapcleanError as fault:
            left_out[method] = str(fault)
    if not checks:
        reasons = " ".join(f"{method}: {reason}" for method, reason in left_out.items())
        raise SolverError(f"none of the methods that auto may choose can be used. {reasons}")
    method = min(checks, key=lambda name: _rank(checks[name].total))
    no_check = checks[method].because
    choice = Choice(
        method=method,
        because=f"the first, as {no_check}" if no_check else "the least 3D error of those that fill the most",
        candidates=tuple(
            Candidate(
                method=name,
                total=checks[name].total if name in checks else Check(),
                left_out=left_out.get(name, ""),
            )
            for name in settings.auto.methods
        ),
    )
    return choice, checks[method]


def _check(method: str, take: Take, wanted: Bools, settings: Settings, dictionary: Dictionary | None) -> SelfCheck:
    """Return the self-check of a candidate; SolverError or UsageError: it cannot be used for this take."""
    if settings.max_error is not None and not SOLVERS[method].TRAITS.error_bars:
        raise SolverError("it gives no error bars, which max_error needs.")
    solve = solver(method, settings, dictionary)
    checked = self_check.check(take, wanted, solve, settings.hiding)
    if checked.because and not take.trusted.all():
        solve(take, wanted)  # raises where the method cannot be used
    return checked


def _rank(total: Check) -> tuple[int, float]:
    """Return the hidden samples left unfilled, then the error, mm; the least is the best."""
    if total.error is None:
        return total.samples, 0.0
    return total.samples - total.error.samples, total.error.rmse_3d
