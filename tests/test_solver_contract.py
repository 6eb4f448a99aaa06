"""The laws that every gap-filling method keeps; each exception stands in one table with its reason.

A toy method, which only the tests register, keeps them too: a new method is one module and one line of the registry.
"""

import dataclasses
from functools import cache

import numpy as np
import pytest
import toy_method
from pydantic import ValidationError
from small_dictionaries import learn

from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.parameters import about, annotations
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.fillable import enclosed, fillable
from mocapclean.solvers.running import run_method
from mocapclean.take import Solution, Take

RATE = 60.0
EXCEPTIONS = {
    ("linear", "better"): "it is the yardstick",
    ("spline", "better"): "no curve through the marker itself can tell what it did over a whole stride",
    ("spline", "turns"): "the slope limiter works on each coordinate",
    ("trnn2", "turns"): "the magnitudes of the first difference are summed coordinate by coordinate",
    ("trnn", "turns"): "the magnitudes of the sparse noise are summed coordinate by coordinate",
    ("tsmc", "turns"): "the magnitudes of the sparse noise are summed coordinate by coordinate",
    ("bolero", "scales"): "markers are a rigid pair when their distance stays within so many millimetres",
    ("scsvt", "scales"): "markers are a rigid pair when their distance stays within so many millimetres",
}
METHODS = [*SOLVERS, "toy"]


@pytest.fixture(autouse=True)
def registered_toy(monkeypatch):
    monkeypatch.setitem(SOLVERS, "toy", toy_method)


def methods(law: str) -> list[str]:
    return [name for name in METHODS if (name, law) not in EXCEPTIONS]


def turn(angle: float) -> np.ndarray:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def walker(n_frames: int = 180) -> np.ndarray:
    """(F, 12, 3) mm: a trunk that walks and sways with two swinging limbs of two segments, 3 markers on each part."""
    t = np.arange(n_frames) / RATE
    trunk = np.stack([900 * t, 40 * np.sin(2 * np.pi * t), 1000 + 25 * np.sin(4 * np.pi * t)], axis=1)
    cluster = np.array([[60.0, 0, 0], [0, 50, 20], [-40, -30, 50]])
    parts = [trunk[:, None] + cluster]
    for side in (-1.0, 1.0):
        upper = 0.5 * side * np.sin(2 * np.pi * t)
        lower = upper + 0.3 * np.cos(2 * np.pi * t + side)
        knee = trunk + [0, 150 * side, -100] + 400 * np.stack([np.sin(upper), 0 * t, -np.cos(upper)], axis=1)
        ankle = knee + 400 * np.stack([np.sin(lower), 0 * t, -np.cos(lower)], axis=1)
        parts.append(knee[:, None] + cluster[:2])
        parts.append(ankle[:, None] + cluster)
    return np.concatenate(parts, axis=1)[:, :12]


def make_take(positions: np.ndarray, trusted: np.ndarray) -> Take:
    names = tuple(f"m{k}" for k in range(positions.shape[1]))
    return Take(positions=positions, trusted=trusted, markers=names, rate=RATE)


@pytest.fixture
def gapped() -> Take:
    """Gaps inside and at both ends, one marker never trusted, short and long dropouts in which nothing is."""
    positions = walker()
    trusted = np.ones(positions.shape[:2], dtype=bool)
    trusted[40:70, 3] = trusted[60:100, 8] = trusted[120:125, 1] = False
    trusted[:12, 5] = trusted[-9:, 10] = False
    trusted[:, 7] = False
    trusted[90] = trusted[130:152] = False
    return make_take(np.where(trusted[..., None], positions, 0.0), trusted)


@cache
def walker_dictionary(scale: float) -> Dictionary:
    learnt = learn(walker(300), RATE)
    atoms = {part: scale * words for part, words in learnt.atoms.items()}
    return dataclasses.replace(learnt, atoms=atoms, poses=scale * learnt.poses)


def answer(name: str, take: Take, *, scale: float = 1.0, **parameters: object) -> Solution:
    module = SOLVERS[name]
    dictionary = walker_dictionary(scale) if module.TRAITS.needs_dictionary else None
    return run_method(name, take, module.Params(**parameters), dictionary=dictionary)


STEADY = {  # where a long way through non-convex or extrapolated iterates magnifies rounding, a way that does not
    "tsmc": {"memory": 0, "max_iterations": 400},
    "trnn": {"growth": 1.4},
}


def steady(name: str, take: Take, **parameters: object) -> Solution:
    return answer(name, take, **STEADY.get(name, {}), **parameters)


def scaled_parameters(name: str, scale: float) -> dict[str, float]:
    """The defaults of the parameters whose unit is mm, in a unit of 1 / scale mm."""
    params = SOLVERS[name].Params
    fields = dataclasses.fields(params)
    return {field.name: field.default * scale for field in fields if about(params, field.name).unit == "mm"}


def filled_difference(one: Solution, other: np.ndarray) -> float:
    return float(np.abs(one.positions - other)[one.filled].max())


@pytest.mark.parametrize("name", METHODS)
def test_shapes_and_input_untouched(name, gapped):
    before = gapped.positions.copy(), gapped.trusted.copy()
    solution = answer(name, gapped)
    assert np.array_equal(gapped.positions, before[0])
    assert np.array_equal(gapped.trusted, before[1])
    assert solution.positions.shape == gapped.positions.shape
    assert solution.positions.dtype == np.float64
    assert solution.filled.shape == gapped.trusted.shape
    assert solution.filled.dtype == bool
    assert np.isfinite(solution.positions[solution.filled]).all()
    assert solution.reason
    assert (solution.sd is not None) == SOLVERS[name].TRAITS.error_bars
    if solution.sd is not None:
        assert solution.sd.shape == gapped.trusted.shape
        assert (solution.sd[solution.filled] >= 0).all()


@pytest.mark.parametrize("name", METHODS)
def test_fills_inside_gaps_and_never_invents(name, gapped):
    filled = answer(name, gapped).filled
    assert not (filled & gapped.trusted).any()
    assert not filled[:, 7].any()
    # What is enclosed is filled, but for the long dropout by methods that need other markers.
    left = enclosed(gapped.trusted) & ~filled
    assert not left[:130].any()
    assert not left[152:].any()
    assert left.any() == SOLVERS[name].TRAITS.extrapolates
    # Nothing is invented beyond the ends of a marker in frames without any.
    assert not (filled & ~fillable(gapped.trusted) & ~enclosed(gapped.trusted)).any()


@pytest.mark.parametrize("name", METHODS)
def test_all_trusted_means_nothing_filled(name):
    positions = walker(30)
    solution = answer(name, make_take(positions, np.ones(positions.shape[:2], dtype=bool)))
    assert not solution.filled.any()
    assert solution.converged


@pytest.mark.parametrize("poison", [1e9, np.nan])
@pytest.mark.parametrize("name", METHODS)
def test_untrusted_samples_are_never_read(name, gapped, poison):
    poisoned = make_take(np.where(gapped.trusted[..., None], gapped.positions, poison), gapped.trusted)
    clean, other = answer(name, gapped), answer(name, poisoned)
    assert np.array_equal(clean.positions[clean.filled], other.positions[other.filled])
    assert np.array_equal(clean.filled, other.filled)


@pytest.mark.parametrize("name", METHODS)
def test_same_bits_twice_and_the_global_random_state_is_left_alone(name, gapped):
    np.random.seed(1)
    first = answer(name, gapped)
    state = np.random.get_state()[1].copy()
    np.random.seed(2)
    second = answer(name, gapped)
    assert first.positions.tobytes() == second.positions.tobytes()
    np.random.seed(1)
    assert np.array_equal(state, np.random.get_state()[1])


@pytest.mark.parametrize("name", METHODS)
def test_permuting_markers_permutes_the_answer(name, gapped, rng):
    order = rng.permutation(len(gapped.markers))
    mixed = steady(name, gapped.select(order))
    plain = steady(name, gapped)
    assert np.array_equal(mixed.filled, plain.filled[:, order])
    assert filled_difference(mixed, plain.positions[:, order]) < 1e-4


@pytest.mark.parametrize("name", methods("moves"))
def test_moving_the_world_moves_the_answer(name, gapped):
    shift = np.array([4000.0, -2500.0, 300.0])
    moved = steady(name, make_take(gapped.positions + shift, gapped.trusted))
    assert filled_difference(moved, steady(name, gapped).positions + shift) < 1e-4


@pytest.mark.parametrize("name", methods("turns"))
def test_turning_the_world_turns_the_answer(name, gapped):
    rotation = turn(0.7)
    turned = answer(name, make_take(gapped.positions @ rotation.T, gapped.trusted))
    assert filled_difference(turned, answer(name, gapped).positions @ rotation.T) < 1e-4


@pytest.mark.parametrize("name", methods("scales"))
def test_millimetres_or_metres_give_the_same_motion(name, gapped):
    metres = make_take(gapped.positions / 1000, gapped.trusted)
    small = steady(name, metres, scale=1e-3, **scaled_parameters(name, 1e-3))
    assert filled_difference(small, steady(name, gapped).positions / 1000) < 1e-7


@pytest.mark.parametrize("name", METHODS)
def test_the_iteration_cap_is_obeyed_and_told(name, gapped):
    if "max_iterations" not in annotations(SOLVERS[name].Params):
        assert answer(name, gapped).iterations == 0
        return
    solution = answer(name, gapped, max_iterations=3)
    assert solution.iterations == 3
    assert not solution.converged
    assert "max_iterations 3" in solution.reason
    free = answer(name, gapped)
    assert free.iterations > 3
    assert free.converged == ("reached" not in free.reason)


@pytest.mark.parametrize("name", METHODS)
def test_defaults_are_valid_and_documented(name):
    module = SOLVERS[name]
    assert module.Params() == module.Params()
    assert module.__doc__
    assert "\n" not in module.REFERENCE
    for parameter in annotations(module.Params):
        meaning = about(module.Params, parameter)
        assert meaning.symbol, parameter
        assert meaning.unit, parameter
        assert meaning.text, parameter
    assert dataclasses.is_dataclass(module.Params)
    with pytest.raises(ValidationError, match="unheard_of"):
        module.Params(unheard_of=1)


@pytest.mark.parametrize("name", methods("better"))
def test_better_than_linear_on_one_second_of_occlusion(name):
    truth = walker(240)
    trusted = np.ones(truth.shape[:2], dtype=bool)
    trusted[80 : 80 + int(RATE), 9] = trusted[140 : 140 + int(RATE), 4] = False
    take = make_take(np.where(trusted[..., None], truth, 0.0), trusted)
    error = {m: np.square((answer(m, take).positions - truth)[~trusted]).mean() for m in (name, "linear")}
    assert error[name] < error["linear"]


def sparse_take(n_frames: int, n_markers: int, *, value: float = 0.0, noise: float = 1.0) -> Take:
    rng = np.random.default_rng(5)
    positions = value + noise * rng.normal(size=(n_frames, n_markers, 3))
    trusted = np.ones((n_frames, n_markers), dtype=bool)
    trusted[n_frames // 2, 0] = False
    return make_take(positions, trusted)


def with_losses(*lost: tuple) -> Take:
    """20 frames of 5 markers with more samples lost, by indices (frames, markers)."""
    take = sparse_take(20, 5)
    trusted = take.trusted.copy()
    for where in lost:
        trusted[where] = False
    return make_take(take.positions, trusted)


EVERY = slice(None)
DEGENERATE = {
    "one marker": sparse_take(9, 1),
    "two markers": sparse_take(9, 2),
    "one frame": sparse_take(1, 4),
    "two frames": sparse_take(2, 4),
    "three frames": sparse_take(3, 2),
    "more columns than frames": sparse_take(7, 12),
    "all of a marker missing": with_losses((EVERY, 2)),
    "all but one marker missing": with_losses((EVERY, slice(1, None))),
    "all but one sample of a marker missing": with_losses((slice(1, None), 3)),
    "a frame with nothing": with_losses((8, EVERY)),
    "only one frame with anything": with_losses((slice(0, 8), EVERY), (slice(9, None), EVERY)),
    "constant": sparse_take(20, 5, value=7.0, noise=0.0),
    "all at the origin": sparse_take(20, 5, noise=0.0),
    "a kilometre away": sparse_take(20, 5, value=1e6),
    "nothing trusted": make_take(np.full((6, 3, 3), np.nan), np.zeros((6, 3), dtype=bool)),
    "no frames": make_take(np.zeros((0, 3, 3)), np.zeros((0, 3), dtype=bool)),
    "no markers": make_take(np.zeros((6, 0, 3)), np.zeros((6, 0), dtype=bool)),
}


def equipped(name: str, take: Take) -> Take:
    """The take with what the method asks for: bones of 1 mm in a chain, or all markers of its dictionary."""
    n_frames, n_markers = take.trusted.shape
    if SOLVERS[name].TRAITS.needs_bones:
        return dataclasses.replace(take, skeleton=chain(take.markers))
    if SOLVERS[name].TRAITS.needs_dictionary:
        positions, trusted = np.zeros((n_frames, 12, 3)), np.zeros((n_frames, 12), dtype=bool)
        positions[:, :n_markers], trusted[:, :n_markers] = take.positions, take.trusted
        return make_take(positions, trusted)
    return take


def chain(names: tuple[str, ...]) -> Skeleton:
    before = np.zeros((len(names), 3))
    before[1:, 0] = 1.0
    return Skeleton(
        names=names,
        parents=tuple(range(-1, len(names) - 1)),
        before=before,
        after=np.zeros_like(before),
        frames=np.tile(np.eye(3), (len(names), 1, 1)),
        channels=(),
        product=(),
    )


def check_sane(name: str, take: Take, solution: Solution) -> None:
    """Filled only where it may be, and not farther away than a few sizes of what is known."""
    assert solution.reason
    assert not (solution.filled & ~(fillable(take.trusted) | enclosed(take.trusted))).any()
    if solution.filled.any():
        known = take.positions[take.trusted]
        sizes = [np.ptp(known, axis=0).max()]
        traits = SOLVERS[name].TRAITS
        sizes += [np.ptp(walker_dictionary(1.0).poses, axis=(0, 1)).max()] if traits.needs_dictionary else []
        sizes += [len(take.markers)] if traits.needs_bones else []
        farthest = np.abs(solution.positions[solution.filled] - known.mean(axis=0)).max()
        assert farthest <= 3 * max(sizes) + 1e-6


@pytest.mark.parametrize("case", DEGENERATE)
@pytest.mark.parametrize("name", METHODS)
def test_degenerate_takes_get_a_sane_answer(name, case):
    take = equipped(name, DEGENERATE[case])
    check_sane(name, take, answer(name, take))


MOST = {"rank": 999, "dimension": 999, "states": 64, "neighbours": 9999, "memory": 50}
RANKED = [name for name, module in SOLVERS.items() if MOST.keys() & annotations(module.Params).keys()]


@pytest.mark.parametrize("case", ["one marker", "two frames", "three frames", "constant"])
@pytest.mark.parametrize("name", RANKED)
def test_ranks_above_the_matrix_are_no_matter(name, case):
    large = {key: value for key, value in MOST.items() if key in annotations(SOLVERS[name].Params)}
    take = equipped(name, DEGENERATE[case])
    check_sane(name, take, answer(name, take, **large))
