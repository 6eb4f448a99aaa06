"""Choose the method that fills a take: that of the settings, or with ``auto`` the best on hidden samples."""

from collections.abc import Callable

from mocapclean import progress
from mocapclean.arrays import Bools
from mocapclean.config.settings import Settings
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.errors import MocapcleanError, SolverError
from mocapclean.evaluation import self_check
from mocapclean.evaluation.self_check import HiddenGaps, SelfCheck
from mocapclean.pipeline.filling import answer
from mocapclean.pipeline.joints import HiddenJoints
from mocapclean.pipeline.outcome import Candidate, MethodChoice
from mocapclean.solvers import SOLVERS
from mocapclean.take import Solution, Take


def solver(
    method: str, settings: Settings, dictionary: Dictionary | None, begun: Solution | None = None
) -> Callable[[Take, Bools], Solution]:
    """Return a function that fills the wanted samples (F, M) of a take by a method with its parameters.

    begun: the answer of the method for the take with more samples trusted, or None.
    """
    params = settings.methods[method]
    return lambda take, wanted: answer(method, take, params, wanted, dictionary, begun)


def settle_method(
    take: Take, wanted: Bools, settings: Settings, dictionary: Dictionary | None
) -> tuple[Settings, MethodChoice | None, SelfCheck | None]:
    """Return the settings with a method in place of auto, how it was chosen, and the self-check of the choice."""
    if settings.method != "auto":
        return settings, None, None
    with progress.within("choosing a method"):
        choice, checked = choose(take, wanted, settings, dictionary)
    return settings.but(method=choice.method), choice, checked


def check_filled(
    take: Take, wanted: Bools, solution: Solution, settings: Settings, dictionary: Dictionary | None
) -> SelfCheck:
    """Return the self-check of a method that has filled the wanted samples (F, M) of a take.

    solution: the answer of the method for the take.
    """
    solve = solver(settings.method, settings, dictionary, solution)
    try:
        with progress.within("self-check"):
            return _hidden_and_filled(take, wanted, solve, settings, settings.too_uncertain)
    except SolverError as error:
        return SelfCheck(because=f"with more samples hidden the method fails: {error}")


def choose(
    take: Take, wanted: Bools, settings: Settings, dictionary: Dictionary | None
) -> tuple[MethodChoice, SelfCheck]:
    """Return which candidate of ``auto.methods`` fills the same hidden samples best, and its self-check.

    The least 3D error wins among the candidates that fill the most of them. Where nothing can be hidden, or no hidden
    sample is filled, the first of those wins that fill the most of the real gaps. Raises SolverError when no candidate
    can be used.
    """
    checks: dict[str, SelfCheck] = {}
    filled: dict[str, int] = {}
    left_out: dict[str, str] = {}
    for method in settings.auto.methods:
        try:
            checks[method], filled[method] = _check(method, take, wanted, settings, dictionary)
        except MocapcleanError as error:
            left_out[method] = str(error)
    if not checks:
        reasons = " ".join(f"{method}: {reason}" for method, reason in left_out.items())
        raise SolverError(f"none of the methods that auto may choose can be used. {reasons}")
    method = min(checks, key=lambda name: (*_rank(checks[name].total), -filled[name]))
    no_check = checks[method].because
    choice = MethodChoice(
        method=method,
        because=f"the first of those that fill the most, as {no_check}"
        if no_check
        else "the least 3D error of those that fill the most",
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


def _check(
    method: str, take: Take, wanted: Bools, settings: Settings, dictionary: Dictionary | None
) -> tuple[SelfCheck, int]:
    """Return the self-check of a candidate, and how many wanted samples it fills where that measures nothing, else 0.

    Raises MocapcleanError where the method cannot be used.
    """
    if settings.max_error is not None and not SOLVERS[method].TRAITS.error_bars:
        raise SolverError("it gives no error bars, which max_error needs.")
    solve = solver(method, settings, dictionary)
    found = checked_before_filling(method, take, wanted, settings, dictionary)
    if found.total.error or take.trusted.all():
        return found, 0
    return found, int((solve(take, wanted).filled & wanted).sum())


def checked_before_filling(
    method: str, take: Take, wanted: Bools, settings: Settings, dictionary: Dictionary | None
) -> SelfCheck:
    """Return the self-check of a method, which first fills the wanted samples (F, M) if it goes gap by gap."""
    solve = solver(method, settings, dictionary)
    if SOLVERS[method].TRAITS.gap_by_gap and take.poses is None:
        solve = solver(method, settings, dictionary, solve(take, wanted))
    return _hidden_and_filled(take, wanted, solve, settings)


def _hidden_and_filled(
    take: Take,
    wanted: Bools,
    solve: Callable[[Take, Bools], Solution],
    settings: Settings,
    leave: Callable[[float | None], bool] = lambda expected: False,
) -> SelfCheck:
    """Return the self-check of a method; with poses the errors are those of the joints' far ends."""
    if take.poses is None:
        return self_check.check(take, wanted, solve, settings.hiding, leave)
    joints = HiddenJoints(take, solve)
    return self_check.check(joints.take, wanted, joints.solve, settings.hiding, leave)


def _rank(total: HiddenGaps) -> tuple[int, float]:
    """Return the number of hidden samples that stayed unfilled, then the 3D error; the smallest pair is best."""
    if total.error is None:
        return total.samples, 0.0
    return total.samples - total.error.samples, total.error.rmse_3d
