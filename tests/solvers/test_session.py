"""Methods that learn from a session: nothing where there is none, more where a take is short, nothing else filled."""

from dataclasses import replace

import numpy as np
import pytest

from mocapclean.simulate import hide
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method
from mocapclean.take import Take
from mocapclean.take.session import MOST_SECONDS, PAUSE, Session, Stretch

RATE = 120.0
NOISE = 0.05  # mm
LEARNING = [name for name, module in SOLVERS.items() if module.TRAITS.learns_from_session]


def motion(n_frames: int, first: int = 0, swing: np.ndarray | float = 1.0) -> np.ndarray:
    """(F, 12, 3) mm: two segments of six markers on a hinge whose angle repeats only after a long time.

    swing: (F,) the share of the angle that is turned.
    """
    rng = np.random.default_rng(3)
    local = rng.normal(size=(2, 6, 3)) * 90
    t = (first + np.arange(n_frames)) / RATE
    place = np.stack([400 * np.sin(0.5 * t), 300 * np.cos(0.4 * t), 900 + 20 * np.sin(5 * t)], axis=1)
    parts = []
    for segment, angle in enumerate((0.5 * np.sin(0.31 * t), swing * (1.2 * np.sin(1.9 * t) + 0.9))):
        cos, sin = np.cos(angle), np.sin(angle)
        turned = np.stack(
            [
                np.outer(cos, local[segment, :, 0]) - np.outer(sin, local[segment, :, 1]),
                np.outer(sin, local[segment, :, 0]) + np.outer(cos, local[segment, :, 1]),
                np.broadcast_to(local[segment, :, 2], (n_frames, 6)),
            ],
            axis=2,
        )
        parts.append(place[:, None] + turned)
        place = place + np.stack([250 * cos, 250 * sin, -100 + 0 * t], axis=1)
    positions = np.concatenate(parts, axis=1)
    return positions + NOISE * np.random.default_rng(first).normal(size=positions.shape)


def take_of(positions: np.ndarray) -> Take:
    names = tuple(f"m{k}" for k in range(positions.shape[1]))
    return Take(positions=positions, trusted=np.ones(positions.shape[:2], bool), markers=names, rate=RATE)


def stretch_of(positions: np.ndarray) -> Stretch:
    return Stretch(positions, np.ones(positions.shape[:2], dtype=bool))


def short_take() -> tuple[Take, np.ndarray]:
    """A take of 300 frames that turns its hinge only while markers 6 to 10 are lost together, and the samples lost."""
    hidden = np.zeros((300, 12), dtype=bool)
    hidden[120:200, 6:11] = True
    swing = np.exp(-np.square((np.arange(300) - 160.0) / 20.0))
    return take_of(motion(300, swing=swing)), hidden


def solved(method: str, take: Take):
    return run_method(method, take, SOLVERS[method].Params())


def assert_same(one, other):
    assert np.array_equal(one.positions, other.positions)
    assert np.array_equal(one.filled, other.filled)
    assert (one.sd is None and other.sd is None) or np.array_equal(one.sd, other.sd)


def test_a_session_without_a_trusted_sample_is_none():
    nothing = Stretch(np.zeros((400, 12, 3)), np.zeros((400, 12), dtype=bool))
    assert Session.of([nothing], RATE) is None
    assert Session.of([], RATE) is None


@pytest.mark.parametrize("method", ["kriging", "pca"])
def test_a_short_take_is_filled_better_from_its_session(method):
    take, hidden = short_take()
    broken = hide(take, hidden)
    session = Session.of([stretch_of(motion(1500, first=4000))], RATE)
    errors = []
    for each in (None, session):
        solution = solved(method, replace(broken, session=each))
        assert np.array_equal(solution.filled, hidden)
        errors.append(np.sqrt(np.square(solution.positions - take.positions)[hidden].mean()))
    assert errors[1] < 0.5 * errors[0]


def test_pma_reads_the_session():
    # Its error in this gap is as large with the same frames in one long take, so that no gain can be asked for here.
    take, hidden = short_take()
    broken = hide(take, hidden)
    session = Session.of([stretch_of(motion(1500, first=4000))], RATE)
    alone, learnt = (solved("pma", replace(broken, session=each)) for each in (None, session))
    assert np.array_equal(learnt.filled, hidden)
    assert not np.array_equal(alone.positions, learnt.positions)


@pytest.mark.parametrize("method", LEARNING)
def test_a_long_take_is_filled_as_without_a_session(method):
    truth = motion(1500)
    hidden = np.zeros((1500, 12), dtype=bool)
    hidden[700:730, 6] = True
    broken = hide(take_of(truth), hidden)
    session = Session.of([stretch_of(motion(900, first=9000))], RATE)
    assert_same(solved(method, broken), solved(method, replace(broken, session=session)))


@pytest.mark.parametrize("method", [name for name in SOLVERS if name in ("linear", "spline", "kalman")])
def test_other_methods_do_not_read_it(method):
    take, hidden = short_take()
    broken = hide(take, hidden)
    session = Session.of([stretch_of(motion(600, first=4000))], RATE)
    assert_same(solved(method, broken), solved(method, replace(broken, session=session)))


@pytest.mark.parametrize("method", LEARNING)
def test_untrusted_samples_of_a_session_are_not_read(method):
    take, hidden = short_take()
    broken = hide(take, hidden)
    trusted = np.ones((1500, 12), dtype=bool)
    trusted[300:500, 2:8] = False
    solutions = []
    for value in (0.0, 1e7, np.nan):
        positions = np.where(trusted[..., None], motion(1500, first=4000), value)
        session = Session.of([Stretch(positions, trusted)], RATE)
        solutions.append(solved(method, replace(broken, session=session)))
    assert_same(solutions[0], solutions[1])
    assert_same(solutions[0], solutions[2])


def test_a_pause_parts_the_stretches_and_nothing_in_it_is_trusted():
    session = Session.of([stretch_of(motion(100)), stretch_of(motion(80, first=900))], RATE)
    pause = round(PAUSE * RATE)
    expected = np.concatenate([np.zeros(pause), np.ones(100), np.zeros(pause), np.ones(80)]).astype(bool)
    assert np.array_equal(session.trusted, np.repeat(expected[:, None], 12, axis=1))


def test_of_a_long_session_the_stretch_of_another_pose_is_kept():
    still = np.repeat(motion(1), round(3 * MOST_SECONDS * RATE), axis=0)
    other = still[:360] * np.array([2.0, 0.5, 1.0])
    session = Session.of([stretch_of(still), stretch_of(other)], RATE)
    assert (session.trusted.any(axis=1)).sum() < 1.2 * MOST_SECONDS * RATE
    places = {tuple(row) for row in session.positions[session.trusted.any(axis=1), 0]}
    assert tuple(other[0, 0]) in places


def test_markers_are_selected_in_a_session_as_in_its_take():
    session = Session.of([stretch_of(motion(50))], RATE)
    take = replace(take_of(motion(30)), session=session)
    columns = np.array([5, 1])
    assert np.array_equal(take.select(columns).session.positions, session.positions[:, columns])
    assert take.crop(0, 20).session is session
    assert take.crop(0, 20, 2).session is None
