"""Frames in which nothing is seen, and markers that move with no other one."""

from dataclasses import replace

import numpy as np
import pytest

from mocapclean.simulate import hide
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.over_time import LONGEST_DROPOUT
from mocapclean.solvers.running import run_method
from mocapclean.take import Solution, Take

RATE = 60.0
LONGEST = round(LONGEST_DROPOUT * RATE)
PLAIN = [name for name, module in SOLVERS.items() if not (module.TRAITS.needs_dictionary or module.TRAITS.needs_bones)]
OTHERS = [name for name in PLAIN if SOLVERS[name].TRAITS.extrapolates]


def moving(n_frames: int = 200, n_markers: int = 6, noise: float = 0.1) -> Take:
    rng = np.random.default_rng(4)
    t = np.arange(n_frames)[:, None] / RATE
    common = np.concatenate([400 * np.sin(2 * t), 300 * np.cos(1.5 * t), 900 + 50 * np.sin(4 * t)], axis=1)
    own = 20 * np.sin(3 * t[:, :, None] + rng.uniform(0, 6, (1, n_markers, 3)))
    positions = common[:, None] + 200 * rng.normal(size=(1, n_markers, 3)) + own
    positions += noise * rng.normal(size=positions.shape)
    names = tuple(f"m{k}" for k in range(n_markers))
    return Take(positions=positions, trusted=np.ones((n_frames, n_markers), bool), markers=names, rate=RATE)


def solved(name: str, take: Take) -> Solution:
    return run_method(name, take, SOLVERS[name].Params())


@pytest.mark.parametrize("name", PLAIN)
@pytest.mark.parametrize("n_markers", [1, 6])
def test_short_dropouts_are_filled_by_every_method(name, n_markers):
    truth = moving(n_markers=n_markers)
    missing = np.zeros_like(truth.trusted)
    missing[50] = missing[80:86] = True
    solution = solved(name, hide(truth, missing))
    assert np.array_equal(solution.filled, missing)
    assert np.linalg.norm((solution.positions - truth.positions)[missing], axis=1).max() < 10.0
    if solution.sd is not None:
        assert (solution.sd[missing] > 0.0).all()


@pytest.mark.parametrize("name", PLAIN)
def test_long_dropouts_are_filled_by_interpolation_alone(name):
    truth = moving()
    missing = np.zeros_like(truth.trusted)
    missing[50 : 50 + LONGEST] = missing[100 : 101 + LONGEST] = missing[:3] = missing[-2:] = True
    filled = solved(name, hide(truth, missing)).filled
    assert filled[50 : 50 + LONGEST].all()
    assert filled[100 : 101 + LONGEST].all() == (not SOLVERS[name].TRAITS.extrapolates)
    assert filled[100 : 101 + LONGEST].any() == (not SOLVERS[name].TRAITS.extrapolates)
    assert not filled[:3].any()
    assert not filled[-2:].any()


def test_error_bars_of_dropouts_hold():
    truth = moving(1200, noise=0.3)
    missing = np.zeros_like(truth.trusted)
    for k, start in enumerate(range(40, 1150, 60)):
        missing[start : start + 1 + k % LONGEST] = True
    solution = solved("kriging", hide(truth, missing))
    assert solution.filled[missing].all()
    errors, sd = (solution.positions - truth.positions)[missing], solution.sd[missing]
    assert 0.8 < (np.abs(errors) <= 1.645 * sd[:, None]).mean() < 0.99


@pytest.mark.parametrize("name", OTHERS)
def test_a_gap_across_a_dropout_is_filled_in_one_piece(name):
    truth = moving()
    missing = np.zeros_like(truth.trusted)
    missing[70:110, 2] = missing[90:93] = True
    solution = solved(name, hide(truth, missing))
    assert solution.filled[missing].all()
    if solution.sd is not None:
        # The neighbours are themselves bridged there, so the error bar is no smaller than beside.
        assert solution.sd[91, 2] >= np.median(solution.sd[[91], [0, 1, 3, 4, 5]])


@pytest.mark.parametrize("name", PLAIN)
def test_a_detached_column_is_filled_from_its_own_path_and_is_nobodys_neighbour(name):
    truth = moving()
    angles = np.stack([12 * np.sin(np.arange(200) / 20), 4 * np.cos(np.arange(200) / 15), np.arange(200) / 100], axis=1)
    positions = np.concatenate([truth.positions, angles[:, None]], axis=1)
    detached = np.arange(7) == 6
    missing = np.zeros((200, 7), dtype=bool)
    missing[60:70, 6] = missing[:5, 6] = missing[120:130, 1] = True
    names = (*truth.markers, "angle")
    take = Take(positions=positions, trusted=~missing, markers=names, rate=RATE, detached=detached)
    solution = solved(name, take)
    assert solution.filled[60:70, 6].all()
    assert not solution.filled[:5, 6].any()
    assert np.abs(solution.positions - positions)[60:70, 6].max() < 1.0
    if solution.sd is not None:
        assert (solution.sd[60:70, 6] > 0.0).all()
    # Whatever the detached column does, all others are filled the same.
    wild = replace(take, positions=np.where(detached[:, None], 1e5 * positions, positions))
    without = take.select(np.arange(6))
    for other in (solved(name, wild), solved(name, without)):
        assert np.array_equal(other.positions[120:130, 1], solution.positions[120:130, 1])


@pytest.mark.parametrize("name", PLAIN)
def test_a_take_of_detached_columns_only(name):
    truth = moving(n_markers=3)
    missing = np.zeros_like(truth.trusted)
    missing[50:58] = missing[90:100, 0] = True
    missing[:4, 1] = True
    take = replace(hide(truth, missing), detached=np.ones(3, dtype=bool))
    solution = solved(name, take)
    assert np.array_equal(solution.filled[4:], missing[4:])
    assert not solution.filled[:4].any()
    assert np.abs(solution.positions - truth.positions)[solution.filled].max() < 20.0


def test_denoising_leaves_bridged_and_detached_samples_out_of_what_moved():
    names = [n for n in PLAIN if SOLVERS[n].TRAITS.cleans_complete_takes]
    for name in names:
        truth = moving()
        missing = np.zeros_like(truth.trusted)
        missing[50:53] = True
        take = replace(hide(truth, missing), detached=np.arange(6) == 5)
        solution = run_method(name, take, SOLVERS[name].Params(denoise=True))
        if solution.moved is not None:
            assert not (solution.moved & missing).any()
            assert not solution.moved[:, 5].any()
