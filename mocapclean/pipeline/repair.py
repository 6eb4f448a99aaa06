"""Repair one take: read, detect, solve, merge, write, verify, and say what happened."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from difflib import get_close_matches
from fnmatch import fnmatchcase
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from mocapclean import formats
from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.config.settings import DEFAULT_METHOD, Settings
from mocapclean.detection import detect
from mocapclean.detection.spans import distrust, read_spans
from mocapclean.dictionaries.dictionary import Dictionary, load
from mocapclean.errors import MocapcleanError, SolverError, UsageError
from mocapclean.evaluation import metrics, self_check
from mocapclean.evaluation.self_check import SelfCheck
from mocapclean.files import check_output
from mocapclean.pipeline import sidecar
from mocapclean.pipeline.choose import choose, solver
from mocapclean.pipeline.outcome import Choice, Outcome
from mocapclean.pipeline.summary import account, judge
from mocapclean.solvers import SOLVERS
from mocapclean.take import Solution, Take
from mocapclean.take.bones import check_names, subject_of


def fill(take: Take, method: str = DEFAULT_METHOD, *, library: Dictionary | None = None, **parameters: Any) -> Take:
    """Fill the untrusted samples of a take with one method; trusted samples come out bit for bit.

    parameters: the method's own (``mocapclean methods`` lists them). library: the trained Dictionary, for methods that
    learn from other takes. Raises UsageError for an unknown method or parameter, SolverError when the method has no
    answer.
    """
    if method not in SOLVERS:
        raise UsageError(f"a method must be one of {', '.join(SOLVERS)}. Got {method!r}.")
    try:
        params = SOLVERS[method].Params(**parameters)
    except ValidationError as invalid:
        faults = "; ".join(f"{f['loc'][0]}: {f['msg']}, got {f['input']!r}" for f in invalid.errors())
        raise UsageError(f"the parameters of {method} must be valid. {faults}.") from None
    return merge(take, SOLVERS[method].solve(take, params, library), np.ones_like(take.trusted))


def merge(take: Take, solution: Solution, wanted: Bools) -> Take:
    """Put a solution's samples into a take where they are wanted (F, M), answered for and untrusted; nowhere else.

    Only a solver that was asked to denoise names trusted samples as ``moved``; these are put in as well.
    """
    filled = wanted & solution.filled & ~take.trusted
    moved = take.trusted & solution.moved if solution.moved is not None else np.zeros_like(filled)
    positions = np.where((filled | moved)[..., None], solution.positions, take.positions)
    return replace(take, positions=positions, filled=take.filled | filled, moved=take.moved | moved)


def repair(source: Path, output: Path, settings: Settings, arrays: Path | None = None) -> Outcome:
    """Repair one file into another. Whatever goes wrong with this take is an Outcome, not an exception.

    arrays: where the sidecar goes, if one is wanted.
    """
    started = perf_counter()
    try:
        outcome = _repair(source, output, settings, arrays)
    except MocapcleanError as fault:
        outcome = Outcome(source=source, status="failed", error=str(fault), exit_code=fault.exit_code)
    except MemoryError:
        message = f"{source}: there is not enough memory for this take."
        outcome = Outcome(source=source, status="failed", error=message, exit_code=1)
    return replace(outcome, seconds=perf_counter() - started)


def _repair(source: Path, output: Path, settings: Settings, arrays: Path | None) -> Outcome:
    check_output(output, source, settings.overwrite)
    take, play = examine(source, settings)
    truth = _reference(settings, play) if settings.reference else None
    wanted = _wanted(play, settings)
    library = load(settings.dictionary) if settings.dictionary else None
    settings, choice, checked = _settled(play, wanted, settings, library)
    if play.trusted.all():
        solution = Solution(positions=play.positions, filled=np.zeros_like(play.trusted), reason="nothing to fill")
    else:
        solution = solver(settings.method, settings, library)(play, wanted)
    sd = _error_bars(play, solution, wanted, settings)
    certain = _certain_enough(play, wanted, sd, settings)
    merged, held = merge(play, solution, certain), merge(play, solution, certain & _holdable(take, solution))
    written = formats.write(_scatter(take, held), output, invalidate=settings.invalidate, overwrite=settings.overwrite)
    with _or_nothing(output):
        after = written.select(_columns(take, play))
        if arrays:
            sidecar.save(arrays, play, after, sd, settings.method)
        outcome = account(play, merged, after, wanted, settings, sd, _largest(take))
        if truth is not None:
            outcome = judge(outcome, after, truth)
        return replace(
            outcome,
            source=source,
            output=output,
            sidecar=arrays,
            format=_format(take),
            source_sha256=digest(source),
            output_sha256=digest(output),
            method=settings.method,
            choice=choice,
            parameters=asdict(settings.params),
            solution=_facts(solution),
            self_check=checked,
            reference=settings.reference,
        )


@contextmanager
def _or_nothing(output: Path) -> Iterator[None]:
    """Take a written output away again when what follows fails, for then its take has failed."""
    try:
        yield
    except BaseException:
        output.unlink(missing_ok=True)
        raise


def _settled(
    play: Take, wanted: Bools, settings: Settings, library: Dictionary | None
) -> tuple[Settings, Choice | None, SelfCheck | None]:
    """The settings with a method in place of auto, how it was chosen, and its self-check where one is made."""
    asked, choice, checked = settings.checks_itself, None, None
    if settings.method == "auto":
        choice, checked = choose(play, wanted, settings, library)
        settings = settings.model_copy(update={"method": choice.method})
    if asked and (checked is None or settings.max_error is not None):
        try:
            solve = solver(settings.method, settings, library)
            checked = self_check.check(play, wanted, solve, settings.hiding, settings.too_uncertain)
        except SolverError as fault:
            checked = SelfCheck(because=f"with more samples hidden the method fails: {fault}")
    return settings, choice, checked


def inspect(source: Path, settings: Settings) -> Outcome:
    """Read and detect, write nothing. Raises what reading raises."""
    take, play = examine(source, settings)
    outcome = account(play, play, play, np.ones_like(play.trusted), settings)
    return replace(outcome, source=source, status="inspected", format=_format(take), source_sha256=digest(source))


def digest(path: Path) -> str:
    """The SHA-256 of a file, as hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def examine(source: Path, settings: Settings) -> tuple[Take, Take]:
    """Read and detect: the whole take as read, and the markers in play with their trust lowered."""
    take = _read(source, settings)
    excluded = np.zeros(len(take.markers), dtype=bool)
    for pattern in settings.exclude:
        excluded[_matching(pattern, take.markers, "--exclude")] = True
    if excluded.all():
        raise UsageError(f"{source}: --exclude must leave at least one marker.")
    play = detect(take.select(np.flatnonzero(~excluded)), {"missing": settings.rules["missing"]})
    if settings.gaps:
        play = distrust(play, read_spans(settings.gaps))
    rules = {name: rule for name, rule in settings.rules.items() if name != "missing"}
    return take, detect(play, rules, fix_swaps=settings.fix_swaps)


def _read(source: Path, settings: Settings) -> Take:
    own_skeleton = formats.needs_skeleton(source)
    options: dict[str, Any] = {"rate": settings.rate, "unit": settings.unit_mm}
    if own_skeleton:
        options["skeleton"] = settings.skeleton
    take = formats.read(source, **options)
    exact = [name for name in settings.markers if not set(name) & set("*?[")]
    others = [name for name in exact if not _matches(name, take.markers)]
    if others and formats.lists_points(source):
        take = formats.read(source, points=others, **options)
    if settings.skeleton and not own_skeleton:
        skeleton = formats.read_skeleton(settings.skeleton, settings.unit_mm)
        check_names(take.markers, skeleton)
        take = replace(take, skeleton=skeleton)
    return take


def _matches(pattern: str, markers: Sequence[str]) -> list[int]:
    return [
        column
        for column, marker in enumerate(markers)
        if fnmatchcase(marker, pattern) or fnmatchcase(subject_of(marker)[1], pattern) or marker == pattern
    ]


def _matching(pattern: str, markers: Sequence[str], option: str) -> list[int]:
    found = _matches(pattern, markers)
    if not found:
        near = get_close_matches(pattern, markers, n=3) or list(markers[:5])
        raise UsageError(f"{option} must name markers of the take. Got {pattern!r}; near: {', '.join(near)}.")
    return found


def _wanted(play: Take, settings: Settings) -> Bools:
    """The samples (F, M) that the user wants filled: of the markers asked for, in gaps not too long."""
    wanted = np.full(play.trusted.shape, not settings.markers)
    for pattern in settings.markers:
        wanted[:, _matching(pattern, play.markers, "--markers")] = True
    if settings.max_gap is not None:
        for marker, start, stop in column_runs(~play.trusted):
            wanted[start:stop, marker] &= stop - start <= settings.max_gap
    return wanted


def _error_bars(play: Take, solution: Solution, wanted: Bools, settings: Settings) -> Floats | None:
    """The sd (F, M) of the wanted samples that the method answered for, NaN elsewhere; None if it gives none."""
    if solution.sd is None and settings.max_error is not None and not play.trusted.all():
        raise UsageError(
            f"max_error must go with a method that gives error bars. {settings.method} gives none as it is set."
        )
    if solution.sd is None:
        return None
    return np.where(wanted & solution.filled & ~play.trusted, solution.sd, np.nan)


def _certain_enough(play: Take, wanted: Bools, sd: Floats | None, settings: Settings) -> Bools:
    """The wanted samples (F, M) without the gaps whose expected 3D error is too large."""
    kept = wanted.copy()
    if sd is not None and settings.max_error is not None:
        for marker, start, stop in column_runs(~play.trusted):
            kept[start:stop, marker] &= not settings.too_uncertain(metrics.expected_error(sd[start:stop, marker]))
    return kept


def _holdable(take: Take, solution: Solution) -> Bools:
    """Where (F, M) the take's file can hold a solution; what is not finite is for the writer to refuse."""
    size = np.abs(solution.positions)
    return np.asarray(~(np.isfinite(size) & (size > _largest(take))).any(axis=2))


def _largest(take: Take) -> float:
    return take.origin.largest if take.origin else np.inf


def _reference(settings: Settings, play: Take) -> Take:
    """The true take, brought to the markers in play; unknown ones are untrusted there."""
    assert settings.reference is not None
    skeleton = settings.skeleton if formats.needs_skeleton(settings.reference) else None
    truth = formats.read(settings.reference, skeleton=skeleton, rate=settings.rate, unit=settings.unit_mm)
    if len(truth.trusted) != len(play.trusted):
        raise UsageError(
            f"{settings.reference}: the reference must have the take's {len(play.trusted)} frames. "
            f"Got {len(truth.trusted)}."
        )
    columns = {name: column for column, name in enumerate(truth.markers)}
    order = np.array([columns.get(name, -1) for name in play.markers])
    if (order < 0).all():
        raise UsageError(f"{settings.reference}: the reference must share marker names with the take.")
    return replace(play, positions=truth.positions[:, order], trusted=truth.trusted[:, order] & (order >= 0))


def _format(take: Take) -> str:
    return take.origin.format if take.origin else ""


def _columns(take: Take, play: Take) -> NDArray[np.intp]:
    place = {name: column for column, name in enumerate(take.markers)}
    return np.array([place[name] for name in play.markers])


def _scatter(take: Take, play: Take) -> Take:
    """The whole take with what happened to the markers in play."""
    columns = _columns(take, play)
    arrays = {name: getattr(take, name).copy() for name in ("positions", "trusted", "filled", "moved")}
    for name, array in arrays.items():
        array[:, columns] = getattr(play, name)
    return replace(take, findings=play.findings, **arrays)


def _facts(solution: Solution) -> Mapping[str, Any]:
    return {
        "converged": solution.converged,
        "iterations": solution.iterations,
        "reason": solution.reason,
        "objective": solution.trace[-1] if solution.trace else None,
        **solution.facts,
    }
