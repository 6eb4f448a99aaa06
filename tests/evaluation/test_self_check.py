"""The self-check: what it hides, what the method is shown, and what it reports."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocapclean.arrays import column_runs
from mocapclean.errors import SolverError
from mocapclean.evaluation import metrics, self_check
from mocapclean.evaluation.self_check import MARGIN, Params, check, hide
from mocapclean.solvers.fillable import enclosed, fillable
from mocapclean.take import Solution, Take


def take_of(trusted: np.ndarray) -> Take:
    positions = np.cumsum(np.random.default_rng(3).normal(size=(*trusted.shape, 3)), axis=0)
    names = tuple(f"m{k}" for k in range(trusted.shape[1]))
    return Take(positions=positions, trusted=trusted, markers=names, rate=100.0)


def gapped(n_frames: int, n_markers: int, *gaps: tuple[int, int, int]) -> Take:
    trusted = np.ones((n_frames, n_markers), dtype=bool)
    for marker, start, stop in gaps:
        trusted[start:stop, marker] = False
    return take_of(trusted)


def everything(take: Take) -> np.ndarray:
    return np.ones_like(take.trusted)


@st.composite
def gapped_takes(draw) -> Take:
    """Takes of any size that lose anything between nothing and nearly all, in runs of any length."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n_frames, n_markers = draw(st.integers(1, 150)), draw(st.integers(1, 6))
    trusted = np.ones((n_frames, n_markers), dtype=bool)
    for _ in range(draw(st.integers(0, 25))):
        start = rng.integers(-10, n_frames)
        trusted[max(start, 0) : start + rng.integers(1, 40), rng.integers(n_markers)] = False
    return take_of(trusted)


@settings(max_examples=150, deadline=None)
@given(gapped_takes(), st.integers(0, 3))
def test_hidden_are_gaps_of_the_take_at_other_trusted_places(take, turn):
    hidden = hide(take, everything(take), Params(least=0.1, most=0.2), turn)
    assert not (hidden & ~take.trusted).any()
    real = list(column_runs(~take.trusted))
    n_frames = len(hidden)
    for marker, start, stop in column_runs(hidden):
        inside = [b - a for m, a, b in real if m == marker and a > 0 and b < n_frames]
        at_ends = [(n_frames - b, n_frames - a) for m, a, b in real if m == marker and (a == 0 or b == n_frames)]
        assert stop - start in inside or (start, stop) in at_ends
        if (start, stop) not in at_ends:
            assert start >= MARGIN
            assert stop <= n_frames - MARGIN
        around = slice(max(start - MARGIN, 0), stop + MARGIN)
        assert take.trusted[around, marker].all()
        assert take.trusted[:, marker].sum() > stop - start
    assert np.array_equal(hidden, hide(take, everything(take), Params(least=0.1, most=0.2), turn))


def test_what_was_lost_together_is_hidden_together():
    take = gapped(400, 6, (0, 50, 80), (1, 55, 90), (3, 60, 70))
    gaps = list(column_runs(hide(take, everything(take), Params(least=0.0))))
    assert [marker for marker, _, _ in gaps] == [0, 1, 3]
    shifts = {start - real for (_, start, _), real in zip(gaps, (50, 55, 60), strict=True)}
    assert len(shifts) == 1
    assert shifts != {0}


def test_hidden_gaps_stay_away_from_real_ones_where_there_is_space():
    take = gapped(1000, 5, (0, 100, 150), (1, 300, 360), (2, 305, 350), (4, 700, 720))
    hidden = hide(take, everything(take), Params(least=0.0))
    assert hidden.sum() == (~take.trusted).sum()
    assert not (hidden.any(axis=1) & ~take.trusted.all(axis=1)).any()


def test_gaps_at_one_end_go_to_the_other():
    take = gapped(100, 3, (0, 0, 10), (1, 0, 7), (2, 95, 100))
    assert list(column_runs(hide(take, everything(take), Params(most=0.2)))) == [
        (0, 90, 100),
        (1, 93, 100),
        (2, 0, 5),
    ]


def test_a_small_loss_is_hidden_many_times_and_a_large_one_in_part():
    one = gapped(1000, 20, (7, 400, 420))
    hidden = hide(one, everything(one), Params(least=0.01))
    assert {marker for marker, _, _ in column_runs(hidden)} == {7}
    assert 140 <= hidden.sum() <= 200
    rng = np.random.default_rng(8)
    starts = [(m, s, s + int(rng.integers(3, 40))) for m in range(20) for s in range(50, 950, 100)]
    many = gapped(1000, 20, *starts)
    hidden = hide(many, everything(many), Params(most=0.05))
    assert 0.03 < hidden.sum() / many.trusted.sum() < 0.06
    lost = np.array([stop - start for _, start, stop in starts])
    for name, members in metrics.by_length(lost.tolist()):
        again = [b - a for _, a, b in column_runs(hidden) if metrics.by_length([b - a])[0][0] == name]
        assert sum(again) / hidden.sum() == pytest.approx(lost[members].sum() / lost.sum(), abs=0.05)


def test_only_gaps_that_are_to_be_filled_are_imitated():
    take = gapped(300, 3, (0, 50, 70), (1, 100, 130))
    wanted = everything(take)
    wanted[:, 1] = False
    assert {marker for marker, _, _ in column_runs(hide(take, wanted, Params()))} == {0}


class Stub:
    """A method that fills what it may, a fixed distance beside the truth, and remembers what it was shown."""

    def __init__(self, take: Take, miss: np.ndarray, sd: np.ndarray | None = None, may=fillable) -> None:
        self.truth, self.miss, self.sd, self.may, self.shown = take.positions, miss, sd, may, []

    def __call__(self, take: Take, wanted: np.ndarray) -> Solution:
        assert wanted.any()
        assert not (wanted & take.trusted).any()
        self.shown.append(take)
        return Solution(positions=self.truth + self.miss, filled=self.may(take.trusted), sd=self.sd)


def test_the_errors_are_those_of_the_hidden_samples_alone():
    take = gapped(400, 4, (0, 50, 58), (1, 200, 300), (2, 0, 5))
    truth = take.positions.copy()
    rng = np.random.default_rng(0)
    miss, sd = rng.normal(size=truth.shape), rng.uniform(0.3, 1.5, take.trusted.shape)
    stub = Stub(take, miss, sd)
    result = check(take, everything(take), stub, Params())
    (shown,) = stub.shown
    hidden = hide(take, everything(take), Params())
    assert np.array_equal(shown.trusted, take.trusted & ~hidden)
    assert np.array_equal(take.positions, truth)
    assert result.because == ""
    assert result.total.gaps == len(list(column_runs(hidden)))
    assert result.total.samples == result.total.error.samples == hidden.sum()
    assert result.total.error.rmse == pytest.approx(np.sqrt(np.mean(miss[hidden] ** 2)))
    assert result.total.covered == pytest.approx(np.mean(np.abs(miss[hidden]) <= 1.645 * sd[hidden][:, None]))
    assert list(result.by_length) == ["1-10", "61-120"]
    for name, low, high in (("1-10", 1, 10), ("61-120", 61, 120)):
        where = np.zeros_like(hidden)
        for marker, start, stop in column_runs(hidden):
            where[start:stop, marker] = low <= stop - start <= high
        assert result.by_length[name].error.rmse == pytest.approx(np.sqrt(np.mean(miss[where] ** 2)))
        assert result.by_length[name].samples == where.sum()


def test_samples_that_the_method_leaves_are_counted_and_not_judged():
    take = gapped(200, 3, (0, 0, 10), (1, 50, 70))
    result = check(take, everything(take), Stub(take, np.ones(3), may=enclosed), Params(least=0.0))
    assert result.total.samples == 30
    assert result.total.error.samples == 20
    assert result.by_length["1-10"] == replace(result.by_length["1-10"], gaps=1, samples=10, error=None)
    assert result.total.covered is None


def test_gaps_that_would_be_left_for_their_expected_error_do_not_count():
    take = gapped(400, 2, (0, 50, 70), (1, 200, 230))
    sd = np.full(take.trusted.shape, [1.0, 9.0])
    result = check(take, everything(take), Stub(take, np.array([2.0, 0, 0]), sd), Params(least=0.0), lambda e: e > 5.0)
    assert (result.total.gaps, result.total.samples, result.total.error.samples) == (2, 50, 20)


def test_every_round_hides_other_samples():
    take = gapped(1000, 4, (0, 50, 70), (1, 200, 230))
    stub = Stub(take, np.ones(3))
    result = check(take, everything(take), stub, Params(rounds=3, least=0.0))
    assert result.rounds == 3
    assert result.total.gaps == 6
    assert len({shown.trusted.tobytes() for shown in stub.shown}) == 3


def fails(take: Take, wanted: np.ndarray) -> Solution:
    raise SolverError("no bone is known.")


@pytest.mark.parametrize(
    ("take", "solve", "because"),
    [
        (gapped(50, 2), fails, "there is no gap to fill of a marker that is seen"),
        (gapped(50, 2, (0, 0, 50)), fails, "there is no gap to fill of a marker that is seen"),
        (gapped(50, 2, (0, 5, 45)), fails, "none of the 1 gaps fits where its marker is trusted"),
        (gapped(0, 2), fails, "there is no gap to fill of a marker that is seen"),
    ],
)
def test_without_an_answer_it_says_why(take, solve, because):
    result = check(take, everything(take), solve, Params())
    assert result.because == because
    assert result.total.error is None


def test_a_method_that_fails_is_not_hushed_up():
    take = gapped(50, 2, (0, 5, 10))
    with pytest.raises(SolverError, match="no bone is known"):
        check(take, everything(take), fails, Params())


def test_a_class_of_which_nothing_can_be_hidden_is_named():
    take = gapped(300, 2, (0, 20, 280), (1, 100, 130))
    result = check(take, everything(take), Stub(take, np.ones(3)), Params())
    assert result.by_length["over 120"] == self_check.HiddenGaps(missing=260)
    assert result.by_length["11-30"].gaps > 0
    assert result.represented == pytest.approx(30 / 290)
    assert (result.total.missing, result.by_length["11-30"].missing) == (290, 30)


def test_error_bars_are_widened_by_what_was_found_and_never_narrowed():
    # Gaps of 8 frames are twice as wrong as expected, gaps of 20 frames half as wrong; none of 150 frames fits.
    take = gapped(400, 3, (0, 50, 58), (1, 200, 220), (2, 10, 395))
    sd = np.full(take.trusted.shape, [1.0, 4.0, 1.0])
    result = check(take, everything(take), Stub(take, np.full(3, 2.0), sd), Params(least=0.0))
    factors = {name: found.factor for name, found in result.by_length.items()}
    assert factors == {"1-10": pytest.approx(2.0), "11-30": 1.0, "over 120": 1.0}
    assert result.by_length["1-10"].expected == pytest.approx(np.sqrt(3.0))
    wide = self_check.widened(sd, take.trusted, result)
    np.testing.assert_allclose(wide[50:58, 0], 2.0)
    assert (wide[200:220, 1] == 4.0).all()
    assert np.array_equal(wide[take.trusted], sd[take.trusted])


def test_a_class_that_was_not_measured_has_the_larger_factor_of_its_neighbours():
    measured = [1.5, None, None, 3.0, None]
    found = {
        f"class {k}": self_check.HiddenGaps(
            missing=5,
            gaps=int(factor is not None),
            error=None if factor is None else metrics.Error(samples=5, rmse=1.0, rmse_3d=factor, largest=factor),
            expected=None if factor is None else 1.0,
        )
        for k, factor in enumerate(measured)
    }
    factors = [each.factor for each in self_check._with_factors(found).values()]
    assert factors == [1.5, 3.0, 3.0, 3.0, 3.0]
    nothing = {"class": self_check.HiddenGaps(missing=5)}
    assert self_check._with_factors(nothing)["class"].factor == 1.0


def test_points_that_follow_a_hidden_marker_exactly_are_hidden_with_it():
    take = gapped(400, 3, (0, 50, 70))
    follower = take.positions[:, 0] + [30.0, 0, 40]
    positions = np.concatenate([take.positions, follower[:, None]], axis=1)
    trusted = np.concatenate([take.trusted, np.ones((400, 1), bool)], axis=1)
    both = Take(positions=positions, trusted=trusted, markers=(*take.markers, "computed"), rate=100.0)
    stub = Stub(both, np.ones(3))
    result = check(both, everything(both), stub, Params(least=0.0))
    (shown,) = stub.shown
    hidden = both.trusted & ~shown.trusted
    assert np.array_equal(hidden[:, 0], hidden[:, 3])
    assert hidden[:, 0].sum() == 20
    # The point itself is not what was asked for.
    assert result.total.samples == 20
