"""Fill a take in memory, as the command does: the function ``mocapclean.fill`` and its result."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.config.settings import DEFAULT_METHOD, Methods, Settings
from mocapclean.detection import RULES, detect
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.errors import UsageError
from mocapclean.evaluation.metrics import GRADES
from mocapclean.evaluation.self_check import SelfCheck
from mocapclean.parameters import annotations, faults
from mocapclean.pipeline.completion import complete, facts, requested, turns
from mocapclean.pipeline.outcome import Counts, GapReport, MethodChoice
from mocapclean.pipeline.summary import summarise
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.names import require_method
from mocapclean.take import Take, require_take
from mocapclean.take.status import Codes, detected

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FillResult:
    """A filled take, with what is known about every sample of it; the numbers are those of the command's report.

    take: with the samples that were filled; ``write`` takes it. sd: (F, M) mm, the standard deviation of a coordinate
    that the method expects, NaN where it has no answer; None where it gives none. A gap that was left may have one.
    status: (F, M) uint8, the ``Status`` of every sample. gaps: every run of untrusted samples, with its status, its
    expected error and its grade. counts: the numbers of samples. method: that filled the take, with its parameters;
    choice: how it was chosen, for method auto. self_check: the errors on hidden samples, or None. facts: how the method
    ended, and what it determined itself.
    """

    take: Take
    sd: Floats | None
    status: Codes
    gaps: tuple[GapReport, ...]
    counts: Counts
    method: str
    parameters: Mapping[str, Any]
    choice: MethodChoice | None = None
    self_check: SelfCheck | None = None
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def grades(self) -> Mapping[str, int]:
        """The number of filled gaps of each grade: good, fair, poor; no gap has one without error bars."""
        counts = Counter(gap.grade for gap in self.gaps)
        return {grade: counts[grade] for grade in GRADES}

    def __repr__(self) -> str:
        checked = self.self_check.total.error if self.self_check else None
        error = f", self-check {checked.rmse_3d:.2f} mm" if checked else ""
        graded = ", ".join(f"{number} {grade}" for grade, number in self.grades.items() if number)
        gaps = f" in {len(self.gaps)} gaps" + (f" ({graded})" if graded else "")
        return f"<FillResult {self.method}: {self.counts.filled:,} filled, {self.counts.left:,} left{gaps}{error}>"

    def to_xarray(self) -> "xr.Dataset":
        """Return the take as an xarray Dataset, with the error bars and the status of every sample."""
        from mocapclean.take.tables import to_xarray  # not needed for a fill

        return to_xarray(self.take, self.status, self.sd)


def fill(
    take: Take,
    method: str = DEFAULT_METHOD,
    *,
    max_gap: int | None = None,
    max_error: float | None = None,
    fill_poor: bool = False,
    keep_contacts: bool = False,
    self_check: Literal["auto"] | bool = "auto",
    markers: str | tuple[str, ...] | list[str] = (),
    dictionary: Dictionary | None = None,
    **parameters: Any,
) -> FillResult:
    """Return a take with its untrusted samples filled, as the command fills them with the same options.

    Nothing is detected: ``detect`` comes before. An untrusted sample without a finding counts as missing in the file.
    method: a name of ``mocapclean methods``, or "auto" for the one that does best on hidden samples. max_gap: frames,
    longer gaps are left. max_error: mm, gaps with a larger expected error are left. fill_poor: also fill gaps that are
    graded poor, or that would bend a rigid pair. keep_contacts: of skeletons, keep feet in place that stand still.
    self_check: measure the error on hidden samples; "auto" where the method asks for it. markers: fill these alone;
    wildcards allowed. dictionary: the trained one, for methods that need one. parameters: the method's own. Raises
    UsageError for an unknown method, option or value, SolverError when the method has no answer.
    """
    require_take(take, "fill")
    settings = _settings(
        method,
        parameters,
        max_gap=max_gap,
        max_error=max_error,
        fill_poor=fill_poor,
        keep_contacts=keep_contacts,
        self_check=self_check,
        markers=(markers,) if isinstance(markers, str) else tuple(markers),
    )
    take = _with_gaps_named(take)
    codes = detected(take)
    wanted = requested(take, codes, settings)
    largest = take.origin.largest if take.origin else np.inf
    done = complete(take, codes, wanted, settings, dictionary, largest)
    outcome = summarise(take, done.take, codes, done.settings, done.sd, turns(take, done.solution, done.sd))
    assert outcome.counts is not None
    return FillResult(
        take=done.take,
        sd=done.sd,
        status=codes,
        gaps=outcome.gaps,
        counts=outcome.counts,
        method=done.settings.method,
        parameters=asdict(done.settings.params),
        choice=done.choice,
        self_check=done.checked,
        facts=facts(done.solution),
    )


def _with_gaps_named(take: Take) -> Take:
    """Return the take in which untrusted samples without a finding have one, as missing in the file."""
    unnamed = ~take.trusted & ~take.distrusted
    if not unnamed.any():
        return take
    missing = {"missing": RULES["missing"].Params()}
    gaps = detect(replace(take, trusted=~unnamed, findings=()), missing).findings
    return replace(take, findings=(*take.findings, *gaps))


def _settings(method: str, parameters: Mapping[str, Any], **options: Any) -> Settings:
    """Return the settings of a fill; raise UsageError for an unknown method, or a parameter or option out of range."""
    require_method(method, "auto")
    if method == "auto" and parameters:
        raise UsageError(f"method auto has no parameters. Got {', '.join(parameters)}.")
    _refuse(faults(Settings, options), "the options of fill")
    settings = Settings(**options).but(method=method)
    if method == "auto":
        return settings
    _refuse_unknown(method, parameters, options)
    _refuse(faults(SOLVERS[method].Params, parameters), f"the parameters of {method}")
    return settings.but(methods=Methods({method: SOLVERS[method].Params(**parameters)}))


def _refuse_unknown(method: str, parameters: Mapping[str, Any], options: Mapping[str, Any]) -> None:
    """Raise UsageError for a keyword that is neither an option of ``fill`` nor a parameter of the method."""
    known = annotations(SOLVERS[method].Params)
    for name in parameters:
        if name not in known:
            similar = get_close_matches(name, [*options, *known], n=1)
            hint = f" Did you mean {similar[0]!r}?" if similar else ""
            raise UsageError(f"{name!r} is neither an option of fill nor a parameter of {method}.{hint}")


def _refuse(refused: list[tuple[str, str, Any]], what: str) -> None:
    """Raise UsageError where values are refused."""
    if refused:
        text = "; ".join(f"{name}: {fault}, got {value!r}" for name, fault, value in refused)
        raise UsageError(f"{what} must be valid. {text}.")
