"""The bench of harm: rules and methods that do a known harm are counted exactly."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from mocapclean.arrays import column_runs
from mocapclean.experiments import harm
from mocapclean.experiments.results import Results, Row
from mocapclean.experiments.trials import Capture, Entry, Request
from mocapclean.formats import c3d
from mocapclean.simulate import VARIATIONS, perform, vary
from mocapclean.simulate.variations import FAULTY, UNCHANGED
from mocapclean.take import Finding, Solution
from tests import commands

ENTRY = Entry(method="kriging")
MOVE = 12.0  # mm, along x, by which the toy method moves what it fills
run = partial(commands.run, "bench")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("takes")
    for seed, name in enumerate(("1_01", "2_01")):
        c3d.create(perform("walk", 3.0, 120.0, seed).markers, folder / f"{name}.c3d")
    c3d.create(perform("walk", 3.0, 120.0, 0).markers.crop(0, 36), folder / "short.c3d")
    c3d.create(perform("walk", 3.0, 120.0, 0).markers.select(np.arange(3)), folder / "three.c3d")
    (folder / "broken.c3d").write_bytes(b"no capture")
    return folder


@pytest.fixture
def capture(folder):
    harm._natural.cache_clear()
    return Capture(path=folder / "1_01.c3d")


def moved_by(take, sd=1.0, answered=None, **options):
    """A method that moves what it fills by 12 mm."""
    filled = ~take.trusted if answered is None else ~take.trusted & answered(take)
    return Solution(positions=take.positions + np.array([MOVE, 0.0, 0.0]), filled=filled, sd=np.full(filled.shape, sd))


def toy(monkeypatch, distrusts, method=moved_by, suspects=()):
    """Let a rule distrust the samples of ``distrusts(take)``, and a toy method fill them."""

    def detect(take):
        findings = tuple(Finding(rule="toy", message="", marker=m, frames=f, suspicion=True) for m, f in suspects)
        return replace(take, trusted=take.trusted & ~distrusts(take), findings=findings)

    monkeypatch.setattr(harm, "detect", detect)
    monkeypatch.setattr(harm, "run_method", lambda name, take, params, **options: method(take))


def block(*columns, start=100, stop=110):
    """A function of a take that returns a mask with some frames of some columns."""

    def mask(take):
        where = np.zeros_like(take.trusted)
        where[start:stop, list(columns)] = True
        return where

    return mask


def test_every_replaced_sample_is_counted_with_its_move(monkeypatch, capture):
    toy(monkeypatch, block(2, 5), suspects=[(capture.take.markers[7], (50, 70))])
    measures, _ = harm.run_detection(UNCHANGED, capture, ENTRY, 0)
    assert measures["samples"] == capture.take.trusted.sum()
    assert (measures["replaced"], measures["anew"], measures["near"], measures["doubted"]) == (20, 0, 0, 0)
    assert measures["suspicious"] == 20
    assert measures["moved"] == pytest.approx(MOVE)
    assert measures["noises"] == pytest.approx(MOVE / harm.noise(capture.take)[[2, 5]].min())


def test_nothing_is_counted_where_nothing_is_replaced(monkeypatch, capture):
    toy(monkeypatch, lambda take: np.zeros_like(take.trusted))
    measures, _ = harm.run_detection(UNCHANGED, capture, ENTRY, 0)
    assert all(measures[name] == 0 for name in ("replaced", "anew", "near", "doubted", "suspicious", "moved", "noises"))


@pytest.mark.parametrize(
    "method",
    [partial(moved_by, sd=30.0), partial(moved_by, answered=lambda take: np.zeros_like(take.trusted))],
    ids=["graded poor", "without an answer"],
)
def test_samples_that_are_distrusted_and_left_are_told_apart(monkeypatch, capture, method):
    toy(monkeypatch, block(2, 5), method)
    measures, _ = harm.run_detection(UNCHANGED, capture, ENTRY, 0)
    assert (measures["replaced"], measures["doubted"], measures["moved"]) == (0, 20, 0)


def test_gaps_graded_fair_are_filled(monkeypatch, capture):
    toy(monkeypatch, block(2, 5), partial(moved_by, sd=10.0))  # an expected 3D error of 17 mm
    assert harm.run_detection(UNCHANGED, capture, ENTRY, 0)[0]["replaced"] == 20
    answers(monkeypatch, off_by(9.0, sd=10.0))
    assert harm.run_fill("still marker", 30, capture, ENTRY, 0)[0]["left"] == 0


def test_what_is_distrusted_in_the_take_as_it_is_is_not_replaced_anew(monkeypatch, capture):
    # The first column in the take as it is, which a loop has twice; the added marker is the last column.
    toy(monkeypatch, block(0))
    twice, _ = harm.run_detection("loop", capture, ENTRY, 0)
    assert (twice["replaced"], twice["anew"]) == (10, 0)
    toy(monkeypatch, block(-1))
    harm._natural.cache_clear()
    anew, _ = harm.run_detection("still marker", capture, ENTRY, 0)
    assert (anew["replaced"], anew["anew"]) == (10, 10)


def test_the_repair_of_a_fault_is_no_harm_and_what_is_beside_it_is(monkeypatch, capture):
    varied = vary(capture.take, "spike", 0)
    ((marker, start, stop),) = column_runs(varied.faulty)

    def distrusts(take):
        if np.array_equal(take.positions, capture.take.positions):
            return np.zeros_like(take.trusted)
        # The fault with 3 frames on both sides, of which 2 are neither right nor wrong, and another marker
        other = block((marker + 1) % len(take.markers), start=start, stop=stop)(take)
        return block(marker, start=start - 3, stop=stop + 3)(take) | other

    toy(monkeypatch, distrusts)
    measures, _ = harm.run_detection("spike", capture, ENTRY, 0)
    assert (measures["replaced"], measures["near"]) == (0, 2 + stop - start)
    n_frames, n_markers = capture.take.trusted.shape
    assert measures["samples"] == (max(0, start - 120) + max(0, n_frames - stop - 120)) * n_markers


def test_replaced_samples_are_counted_by_their_rule(monkeypatch, capture):
    distrusts = block(-1)
    monkeypatch.setattr(harm, "_natural", lambda capture: np.zeros_like(capture.take.trusted))
    toy(monkeypatch, distrusts)
    monkeypatch.setattr(harm, "detect", partial(found_by, harm.detect, "drift"))
    measures, _ = harm.run_detection("still marker", capture, ENTRY, 0)
    by_rule = {name: value for name, value in measures.items() if name.startswith("by ") and value}
    assert by_rule == {"by drift": 6}


def found_by(detect, rule, take):
    """The answer of a toy rule with a finding about some of its samples, frames 104 to 109."""
    finding = Finding(rule=rule, message="", marker=take.markers[-1], frames=(104, 120))
    return replace(detect(take), findings=(finding,))


def test_a_fault_counts_only_far_away(monkeypatch, capture):
    # A drift, which lasts to the end, that begins late enough
    starts = {seed: next(column_runs(vary(capture.take, "drift", seed).faulty))[1] for seed in range(10)}
    seed, start = next(item for item in starts.items() if item[1] > 125)
    toy(monkeypatch, block(3, start=start - 125, stop=start - 115))
    monkeypatch.setattr(harm, "_natural", lambda capture: np.zeros_like(capture.take.trusted))
    measures, _ = harm.run_detection("drift", capture, ENTRY, seed)
    assert (measures["replaced"], measures["anew"], measures["near"]) == (5, 5, 5)
    assert measures["samples"] == (start - 120) * len(capture.take.markers)


def test_the_noise_is_that_of_white_noise_on_a_smooth_path(rng):
    take = perform("walk", 5.0, 120.0, 0).markers.select(np.arange(3))
    path = np.cumsum(np.ones((600, 3, 3)), axis=0)
    sd = np.array([0.05, 0.3, 2.0])
    noisy = path + rng.normal(size=path.shape) * sd[:, None]
    np.testing.assert_allclose(harm.noise(replace(take, positions=noisy)), [0.1, 0.3, 2.0], rtol=0.1)
    unseen = replace(take, positions=np.full_like(path, np.nan), trusted=np.zeros((600, 3), bool))
    np.testing.assert_array_equal(harm.noise(unseen), [0.1, 0.1, 0.1])


def answers(monkeypatch, answer):
    """Let hidden gaps be filled with ``answer(truth, hidden)``, with an sd of 1 mm."""
    monkeypatch.setattr(harm, "solve", lambda truth, hidden, entry: (answer(truth, hidden), 0.5))


def off_by(offset, sd=1.0):
    """An answer that is off by so many mm."""
    return lambda truth, hidden: Solution(
        positions=truth.positions + np.array([0.0, offset, 0.0]), filled=hidden, sd=np.full(hidden.shape, sd)
    )


@pytest.mark.parametrize("frames", harm.LENGTHS)
@pytest.mark.parametrize("kind", ["still marker", "still marker, ends", "box, all markers", "box, ends"])
def test_harm_of_a_resting_thing_is_the_error_less_its_noise(monkeypatch, capture, kind, frames):
    answers(monkeypatch, off_by(9.0))
    measures, series = harm.run_fill(kind, frames, capture, ENTRY, 0)
    n_gaps = (2 if "ends" in kind else 3) * (4 if "box" in kind else 1)
    assert (measures["gaps"], measures["left"], measures["harmed"]) == (n_gaps, 0, n_gaps)
    np.testing.assert_allclose(series["error"], 9.0)
    np.testing.assert_allclose(series["harm"], 9.0 - np.minimum(series["linear"], series["still"]))
    assert np.minimum(series["linear"], series["still"]).max() < 1.0
    assert measures["worst"] == series["harm"].max()


def test_a_perfect_answer_harms_nothing(monkeypatch, capture):
    answers(monkeypatch, off_by(0.0))
    for kind in harm.GAPS:
        measures, series = harm.run_fill(kind, 30, capture, ENTRY, 0)
        assert (measures["gaps"] > 0, measures["harmed"], measures["worst"]) == (True, 0, 0)
        assert (series["harm"] <= 0).all()


def test_harm_that_the_grade_leaves_is_counted_apart(monkeypatch, capture):
    answers(monkeypatch, off_by(9.0, sd=30.0))
    measures, _ = harm.run_fill("still marker", 30, capture, ENTRY, 0)
    assert [measures[name] for name in ("gaps", "left", "harmed", "harmed_if_left", "worst")] == [3, 3, 0, 3, 0]


def test_holding_still_repeats_the_sample_before_a_gap_or_at_the_start_the_next(capture):
    take = capture.take.crop(0, 10)
    hidden = np.zeros_like(take.trusted)
    hidden[:3, 0] = hidden[4:6, 0] = hidden[8:, 1] = True
    frames = np.arange(10)[:, None].repeat(hidden.shape[1], 1)
    frames[:3, 0], frames[4:6, 0], frames[8:, 1] = 3, 3, 7
    expected = np.take_along_axis(take.positions, frames[..., None], axis=0)
    np.testing.assert_array_equal(harm._held(take, hidden), expected)


def test_linear_is_harmful_only_where_holding_still_is_better(capture):
    for kind in harm.GAPS:
        _, series = harm.run_fill(kind, 60, capture, Entry(method="linear"), 0)
        inside = series["filled"] > 0
        np.testing.assert_allclose(series["error"][inside], series["linear"][inside])
        np.testing.assert_allclose(
            series["harm"][inside], np.maximum(0.0, series["linear"] - series["still"])[inside], atol=1e-9
        )


@pytest.mark.parametrize("kind", harm.GAPS)
@pytest.mark.parametrize("frames", harm.LENGTHS)
def test_gaps_have_their_length_and_known_samples_beside_them(monkeypatch, capture, kind, frames):
    hiding = []

    def answer(truth, hidden):
        hiding.append((truth, hidden))
        return off_by(0.0)(truth, hidden)

    answers(monkeypatch, answer)
    harm.run_fill(kind, frames, capture, ENTRY, 0)
    ((truth, hidden),) = hiding
    for marker, start, stop in column_runs(hidden):
        assert stop - start == frames
        assert truth.trusted[start:stop, marker].all()
        beside = [frame for frame in (start - 1, stop) if 0 <= frame < len(hidden)]
        assert len(beside) == (1 if "ends" in kind else 2)
        assert truth.trusted[beside, marker].all()


def test_takes_that_cannot_be_used_are_named(folder):
    request = Request(captures=tuple(Capture(path=path) for path in sorted(folder.glob("*.c3d"))))
    captures, left_out = harm.selected(request)
    assert [capture.name for capture in captures] == ["1_01", "2_01"]
    assert left_out == ["broken.c3d (cannot be read)", "short.c3d (36 frames)", "three.c3d (3 markers seen)"]
    assert "chosen on: 1_01" in harm.notes(request)
    assert "reported on: 2_01" in harm.notes(request)
    assert harm.notes(request)[-1].startswith("left out: broken.c3d")


def test_captures_are_cropped(folder, monkeypatch):
    monkeypatch.setattr(harm, "MOST_FRAMES", 100)
    request = Request(captures=(Capture(path=folder / "1_01.c3d"),))
    assert len(harm.selected(request)[0][0].take.trusted) == 100


def test_all_cases_are_tried_with_every_seed(folder):
    request = Request(captures=(Capture(path=folder / "1_01.c3d"),), n_seeds=2)
    cells = [(*trial.cell.values(), trial.seed) for trial in harm.trials(request)]
    assert len(set(cells)) == len(cells) == 2 * (len(VARIATIONS) + 3 * len(harm.GAPS)) - 1
    assert {*FAULTY, UNCHANGED} <= {cell[0] for cell in cells}


def row(take, seed=0, values=None, series=None, **cell):
    return Row(
        take=take,
        method="kriging",
        variant="",
        parameters="{}",
        cell={k: str(v) for k, v in cell.items()},
        seed=seed,
        values=values or {},
        series=lambda: series or {},
    )


def counts(samples, replaced, **more):
    zero = dict.fromkeys(("anew", "near", "doubted", "suspicious", "moved", "noises"), 0.0)
    return {**zero, "samples": samples, "replaced": replaced, **more}


def test_tables_pool_and_take_the_median_over_takes():
    series = {name: np.array(v) for name, v in {"harm": [5.0, 9.0], "error": [6.0, 9.5], "linear": [1.0, 0.5]}.items()}
    series |= {"still": np.array([2.0, 3.0]), "filled": np.array([1.0, 0.0])}
    gaps = {"gaps": 2, "left": 1, "harmed": 1, "harmed_if_left": 1, "worst": 5.0}
    results = Results(
        (
            row("a", values=counts(1000, 0), variation=UNCHANGED),
            row("b", values=counts(1000, 4, anew=0, moved=3.0, noises=2.0), variation=UNCHANGED),
            row("c", values=counts(3000, 60, moved=7.0, noises=9.0), variation=UNCHANGED),
            row("d", values={}, variation="cut"),
            row("c", values=counts(1000, 5, anew=2) | {"by drift": 2, "by jump": 1}, variation="loop"),
            row("a", values=gaps, series=series, gaps="box, ends", frames=30),
        )
    )
    detection, by_rule, gaps_table, takes, worst = harm.tables(results)
    both = next(cells for cells in detection.rows if cells[:2] == ("both", "all"))
    assert both[2:6] == ("3", "6000", "400", "1150")
    first = next(cells for cells in detection.rows if cells[:2] == ("chosen on", UNCHANGED))
    assert first[2:6] == ("2", "4000", "1000", "1500")
    assert first[-2:] == ("7.00", "9.00")
    assert not any(cells[1] == "cut" for cells in detection.rows)
    assert (by_rule.header, by_rule.rows) == (("variation", "drift", "jump"), (("loop", "2", "1"),))
    assert gaps_table.rows[0] == ("chosen on", "box, ends", "30", "2", "1", "1", "1", "5.00")
    assert [cells[:4] for cells in takes.rows] == [
        ("c", UNCHANGED, "0", "60.0"),
        ("c", "loop", "0", "5.00"),
        ("b", UNCHANGED, "0", "4.00"),
    ]
    assert worst.rows == (("a", "box, ends", "30", "0", "5.00", "6.00", "1.00", "2.00"),)


def test_the_command_prints_what_it_left_out(folder, tmp_path):
    code, text, err = run(
        "harm", "--folder", folder, "--quick", "--methods", "linear", "--no-plots", "--out-dir", tmp_path
    )
    assert (code, err) == (0, "")
    assert "left out: broken.c3d (cannot be read), short.c3d (36 frames), three.c3d (3 markers seen)" in text
    assert "two subjects" in text
    assert "box, all markers" in text
