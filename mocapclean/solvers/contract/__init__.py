"""The laws that every gap-filling method keeps, of this project or of another package, as functions that try them.

A law takes a ``Subject`` and raises ``BrokenLaw`` with the reason where the method does not keep it.
"""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.parameters import about, annotations, faults
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.contract import takes
from mocapclean.solvers.fillable import enclosed, fillable
from mocapclean.solvers.method import Method, Traits
from mocapclean.solvers.running import run_method
from mocapclean.take import Solution, Take

# Chosen by hand: far below any error of a method, and above what rounding does in long iterations.
_SAME_MM = 1e-4  # mm, between two answers that must be the same
_SAME_M = 1e-7  # m, the same where the unit is a metre
_SIZES = 3.0  # sizes of what is known, from its mean, within which a sane answer lies
_POISON = (1e9, np.nan)  # mm, put where nothing is trusted
_CAP = 3  # iterations at which an iteration is stopped


class BrokenLaw(Exception):  # noqa: N818
    """A method does not keep a law; the message tells what happened."""


@dataclass(frozen=True)
class Subject:
    """A registered method on which laws are tried, by its name and its module.

    steady: parameters of a way to the answer that does not magnify rounding, for laws that compare two answers.
    """

    name: str
    module: Method
    steady: Mapping[str, Any] = field(default_factory=dict)

    @property
    def traits(self) -> Traits:
        """The traits of the method."""
        return self.module.TRAITS

    def answer(self, take: Take, *, scale: float = 1.0, **parameters: Any) -> Solution:
        """Return the method's answer for a take whose unit of length is 1 / scale millimetres."""
        dictionary = takes.walker_dictionary(scale) if self.traits.needs_dictionary else None
        return run_method(self.name, take, self.module.Params(**parameters), dictionary=dictionary)

    def equipped(self, take: Take) -> Take:
        """Return a take with what the method asks for: bones, or all markers of its dictionary."""
        if self.traits.needs_bones:
            return takes.with_bones(take)
        return takes.with_all_markers(take) if self.traits.needs_dictionary else take


@dataclass(frozen=True)
class Law:
    """A law of methods. is_required: whether a method that breaks it must not be used."""

    name: str
    statement: str
    holds: Callable[[Subject], None]
    is_required: bool = True


def try_laws(subject: Subject) -> dict[Law, str]:
    """Return for each law why the method breaks it, or "" where it keeps it."""
    results = {}
    for law in LAWS:
        try:
            law.holds(subject)
        except BrokenLaw as broken:
            results[law] = str(broken)
        except Exception as fault:
            results[law] = f"it raises {type(fault).__name__}: {fault}"
        else:
            results[law] = ""
    return results


def _require(condition: Any, reason: str) -> None:
    """Raise BrokenLaw with a reason unless a condition is true."""
    if not condition:
        raise BrokenLaw(reason)


def _difference(one: Solution, other: Floats) -> float:
    """Return the largest difference, mm, of the filled coordinates of a solution to positions (F, M, 3)."""
    return float(np.abs(one.positions - other)[one.filled].max(initial=0.0))


def _documented(subject: Subject) -> None:
    module = subject.module
    _require(isinstance(module.TRAITS, Traits), "TRAITS must be a Traits of mocapclean.solvers.method")
    _require(dataclasses.is_dataclass(module.Params), "Params must be a class with @parameters")
    _require(module.Params() == module.Params(), "Params must be equal with equal values")
    _require(module.__doc__, "the module must have a docstring")
    _require(module.REFERENCE and "\n" not in module.REFERENCE, "REFERENCE must be one line")
    for name in annotations(module.Params):
        try:
            meaning = about(module.Params, name)
        except ValueError:
            raise BrokenLaw(f"the parameter {name} must have an About") from None
        _require(meaning.symbol and meaning.unit and meaning.text, f"the About of {name} must have no empty part")
    _require(faults(module.Params, {"unheard_of": 1}), "Params must refuse an unknown name")


def _shapes(subject: Subject) -> None:
    take = takes.gapped()
    positions, trusted = take.positions.copy(), take.trusted.copy()
    solution = subject.answer(take)
    same = np.array_equal(take.positions, positions) and np.array_equal(take.trusted, trusted)
    _require(same, "the take that it is given must stay as it is")
    _require(solution.positions.shape == take.positions.shape, "positions must be (F, M, 3)")
    _require(solution.positions.dtype == np.float64, "positions must be float64")
    _require(solution.filled.shape == take.trusted.shape, "filled must be (F, M)")
    _require(solution.filled.dtype == bool, "filled must be bool")
    _require(np.isfinite(solution.positions[solution.filled]).all(), "filled positions must be finite")
    _require(solution.reason, "reason must tell how the method ended")
    has_bars = solution.sd is not None
    _require(has_bars == subject.traits.error_bars, "sd must be there as TRAITS.error_bars states")
    if solution.sd is not None:
        _require(solution.sd.shape == take.trusted.shape, "sd must be (F, M)")
        _require((solution.sd[solution.filled] >= 0).all(), "sd must not be negative")


def _fills(subject: Subject) -> None:
    take = takes.gapped()
    filled = subject.answer(take).filled
    _require(not (filled & take.trusted).any(), "a trusted sample must not be filled")
    _require(not filled[:, 7].any(), "a marker that is never seen must not be filled")
    # What is enclosed is filled, but for the long dropout by methods that need other markers.
    left = enclosed(take.trusted) & ~filled
    _require(not left[:130].any() and not left[152:].any(), "a gap between two trusted samples must be filled")
    _require(left.any() == subject.traits.extrapolates, "TRAITS.extrapolates must state what is filled at the ends")
    beyond = filled & ~fillable(take.trusted) & ~enclosed(take.trusted)
    _require(not beyond.any(), "beyond the ends of a marker nothing is filled in frames in which nothing is seen")


def _complete(subject: Subject) -> None:
    positions = takes.walker(30)
    solution = subject.answer(takes.make_take(positions, np.ones(positions.shape[:2], dtype=bool)))
    _require(not solution.filled.any(), "nothing must be filled where all is trusted")
    _require(solution.converged, "nothing to do must count as converged")


def _unread(subject: Subject) -> None:
    # Without dropouts, because the take is a cleaned copy where a dropout has been bridged.
    take = takes.gapped(dropouts=False)
    clean = subject.answer(take)
    for poison in _POISON:
        other = subject.answer(takes.make_take(np.where(take.trusted[..., None], take.positions, poison), take.trusted))
        same = np.array_equal(clean.positions[clean.filled], other.positions[other.filled])
        _require(
            same and np.array_equal(clean.filled, other.filled), f"{poison} in untrusted samples changes the answer"
        )


def _repeatable(subject: Subject) -> None:
    take, before = takes.gapped(), np.random.get_state()
    try:
        np.random.seed(1)
        state = np.random.get_state()[1].copy()  # type: ignore[index]
        first = subject.answer(take)
        untouched = np.array_equal(state, np.random.get_state()[1])  # type: ignore[index]
        np.random.seed(2)
        second = subject.answer(take)
    finally:
        np.random.set_state(before)
    _require(first.positions.tobytes() == second.positions.tobytes(), "two runs must give the same bits")
    _require(untouched, "NumPy's global random state must be left alone")


def _cap(subject: Subject) -> None:
    take = takes.gapped()
    free = subject.answer(take)
    if "max_iterations" not in annotations(subject.module.Params):
        _require(free.iterations == 0, "iterations must be 0 without the parameter max_iterations")
        return
    capped = subject.answer(take, max_iterations=_CAP)
    _require(capped.iterations == _CAP, f"max_iterations {_CAP} must give {_CAP} iterations, not {capped.iterations}")
    told = not capped.converged and f"max_iterations {_CAP}" in capped.reason
    _require(told, "an iteration that is stopped must tell so in converged and reason")
    _require(free.iterations > _CAP, "the default must allow more iterations")
    _require(free.converged == ("reached" not in free.reason), "converged must agree with reason")


def _order(subject: Subject) -> None:
    take = takes.gapped()
    order = np.random.default_rng(20181).permutation(len(take.markers))
    mixed, plain = subject.answer(take.select(order), **subject.steady), subject.answer(take, **subject.steady)
    _require(np.array_equal(mixed.filled, plain.filled[:, order]), "another order of markers fills other samples")
    _compare(_difference(mixed, plain.positions[:, order]), _SAME_MM, "mm", "another order of markers")


def _moves(subject: Subject) -> None:
    take, shift = takes.gapped(), np.array([4000.0, -2500.0, 300.0])
    moved = subject.answer(takes.make_take(take.positions + shift, take.trusted), **subject.steady)
    plain = subject.answer(take, **subject.steady)
    _compare(_difference(moved, plain.positions + shift), _SAME_MM, "mm", "another origin")


def _turns(subject: Subject) -> None:
    take, (cos, sin) = takes.gapped(), (np.cos(0.7), np.sin(0.7))
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    turned = subject.answer(takes.make_take(take.positions @ rotation.T, take.trusted))
    _compare(_difference(turned, subject.answer(take).positions @ rotation.T), _SAME_MM, "mm", "a turn of the world")


def _scales(subject: Subject) -> None:
    take, scale = takes.gapped(), 1e-3
    params = subject.module.Params
    # The defaults of the parameters whose unit is mm, in metres
    lengths = {
        each.name: getattr(params(), each.name) * scale
        for each in dataclasses.fields(params)
        if about(params, each.name).unit == "mm"
    }
    metres = takes.make_take(take.positions * scale, take.trusted)
    small = subject.answer(metres, scale=scale, **subject.steady, **lengths)
    plain = subject.answer(take, **subject.steady)
    _compare(_difference(small, plain.positions * scale), _SAME_M, "m", "metres in place of millimetres")


def _compare(difference: float, limit: float, unit: str, cause: str) -> None:
    """Raise BrokenLaw where two answers differ by more than a limit."""
    _require(difference < limit, f"{cause} changes the answer by {difference:.2g} {unit}, more than {limit:g}")


def _sane(subject: Subject) -> None:
    for name, case in takes.degenerate().items():
        take = subject.equipped(case)
        try:
            check_sane(subject, take, subject.answer(take))
        except BrokenLaw as broken:
            raise BrokenLaw(f"of a take with {name}: {broken}") from None
        except Exception as fault:
            raise BrokenLaw(f"of a take with {name}: it raises {type(fault).__name__}: {fault}") from fault


def check_sane(subject: Subject, take: Take, solution: Solution) -> None:
    """Raise BrokenLaw unless only what may be is filled, not farther away than a few sizes of what is known."""
    _require(solution.reason, "reason must tell how the method ended")
    allowed = fillable(take.trusted) | enclosed(take.trusted)
    _require(not (solution.filled & ~allowed).any(), "a sample is filled that must not be")
    if not solution.filled.any():
        return
    known = take.positions[take.trusted]
    sizes = [float(np.ptp(known, axis=0).max())]
    if subject.traits.needs_dictionary:
        sizes.append(float(np.ptp(takes.walker_dictionary(1.0).poses, axis=(0, 1)).max()))
    if subject.traits.needs_bones:
        sizes.append(float(len(take.markers)))
    farthest = float(np.abs(solution.positions[solution.filled] - known.mean(axis=0)).max())
    # The part of the mean is what its rounding allows.
    limit = _SIZES * max(sizes) + 1e-6
    _require(farthest <= limit, f"a sample is filled {farthest:.3g} mm from the others, more than {limit:.3g} mm")


def _better(subject: Subject) -> None:
    take, truth = takes.occluded()
    own, lines = (
        float(np.sqrt(np.square((each.answer(take).positions - truth)[~take.trusted]).mean()))
        for each in (subject, Subject("linear", SOLVERS["linear"]))
    )
    _require(own < lines, f"its RMSE is {own:.1f} mm, that of straight lines {lines:.1f} mm")


LAWS = (
    Law(
        "documented",
        "its reference, traits and parameters are declared, and unknown parameters are refused",
        _documented,
    ),
    Law("shapes", "its arrays have the shapes and types of a Solution, and the take stays as it is", _shapes),
    Law("fills", "it fills what is enclosed, and neither trusted samples nor markers that are never seen", _fills),
    Law("complete", "it fills nothing where all is trusted", _complete),
    Law("unread", "it never reads an untrusted sample", _unread),
    Law("repeatable", "it gives the same bits twice, and leaves the global random state alone", _repeatable),
    Law("cap", "it stops at max_iterations and tells so", _cap),
    Law("order", "the order of the markers does not matter", _order),
    Law("moves", "the origin of the world does not matter", _moves),
    Law("sane", "takes that are short, flat, empty or far away get a sane answer", _sane),
    Law("turns", "the direction of the axes does not matter", _turns, is_required=False),
    Law("scales", "the unit of length does not matter", _scales, is_required=False),
    Law(
        "better",
        "it is better than straight lines where two markers are not seen for a second",
        _better,
        is_required=False,
    ),
)
"""The laws; those that are not required tell a user what the method cannot do."""
