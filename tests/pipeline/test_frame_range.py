"""``frames`` and ``events``: all other samples keep their bytes, and are neither judged nor counted."""

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from c3d_builder import C3D, INTEL, floats, texts
from commands import run
from conftest import SAMPLES
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mocapclean import formats
from mocapclean.config.loading import resolve
from mocapclean.config.ranges import event_names, frame_limits
from mocapclean.errors import ConfigError
from mocapclean.formats import c3d
from mocapclean.pipeline.check import CheckTake
from mocapclean.pipeline.inspection import inspect
from mocapclean.pipeline.rebuilding import rebuilt_view
from mocapclean.pipeline.repair import repair
from mocapclean.report import record
from mocapclean.simulate import inject, perform
from mocapclean.take.status import Status

SCHEMA = json.loads((Path(__file__).resolve().parents[2] / "docs" / "report.schema.json").read_text(encoding="utf-8"))
N_FRAMES, FIRST = 60, 11
QUICK = {"method": "linear", "self_check": False, "overwrite": True}
EVENTS = [("Foot Strike", "Left", 0.1), ("Foot Off", "Left", 0.25), ("Foot Strike", "Left", 0.4)]


def points(missing=()):
    """Stored numbers of five markers that swing, without the samples (frame, marker) that are missing."""
    frames = np.arange(N_FRAMES)[:, None]
    found = np.full((N_FRAMES, 5, 4), 3.0)
    found[..., :3] = (300 * np.arange(1, 6) + 40 * np.sin(frames / 9))[..., None] + 20 * np.arange(3)
    for frame, marker in missing:
        found[frame, marker] = [0, 0, 0, -1]
    return found


def events(stated=EVENTS, machine=INTEL):
    """Parameters of the group EVENT; times are seconds from frame 1 of the trial."""
    times = [each for _, _, seconds in stated for each in (0.0, seconds)]
    return {
        "EVENT:USED": ("EVENT", "USED", 2, (), len(stated).to_bytes(2, "little")),
        "EVENT:CONTEXTS": texts("EVENT", "CONTEXTS", [context for _, context, _ in stated], 16),
        "EVENT:LABELS": texts("EVENT", "LABELS", [label for label, _, _ in stated], 16),
        "EVENT:TIMES": ("EVENT", "TIMES", 4, (2, len(stated)), floats(times, machine)),
    }


def store(folder, missing=(), extra=None):
    path = folder / "take.c3d"
    path.write_bytes(C3D(points(missing), first_frame=FIRST, extra=extra or {}).build())
    return path


def repaired(path, **options):
    output = path.with_name("out.c3d")
    outcome = repair(path, output, resolve(None, {**QUICK, **options}))
    assert outcome.status != "failed", outcome.error
    return outcome, output


def bytes_of_frames(frames):
    """Which bytes of the file hold these frames: those in which files with other numbers there differ."""
    ones, others = points(), points()
    ones[frames], others[frames] = 1.0, -9.5e17
    one, other = (np.frombuffer(C3D(each, first_frame=FIRST).build(), "u1") for each in (ones, others))
    inside = np.flatnonzero(one != other)
    return slice(inside.min(), inside.max() + 1)


SAMPLES_LOST = st.lists(st.tuples(st.integers(0, N_FRAMES - 1), st.integers(0, 4)), max_size=60)
SPANS = st.lists(st.integers(0, N_FRAMES - 1), min_size=2, max_size=2).map(sorted)


@given(missing=SAMPLES_LOST, span=SPANS, changes=st.sampled_from(["sure", "suspicious"]), invalidate=st.booleans())
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_all_samples_outside_keep_their_bytes_and_have_one_status(tmp_path, missing, span, changes, invalidate):
    path = store(tmp_path, missing)
    start, last = span
    (tmp_path / "bad.csv").write_text(f"M1,{FIRST + 5},{FIRST + 30}\n")
    frames = f"{FIRST + start}:{FIRST + last}"
    options = {"replace": changes, "fix_swaps": True, "invalidate": invalidate, "gaps": str(tmp_path / "bad.csv")}
    outcome, output = repaired(path, frames=frames, **options)
    old, new = (np.frombuffer(each.read_bytes(), "u1") for each in (path, output))
    changed = np.flatnonzero(old != new)
    inside = bytes_of_frames(slice(start, last + 1))
    assert changed.size == 0 or (inside.start <= changed.min() and changed.max() < inside.stop)
    outside = 5 * (N_FRAMES - (last + 1 - start))
    assert outcome.statuses.get(Status.OUTSIDE, 0) == outcome.counts.outside == outside
    assert outcome.counts.samples == 5 * (last + 1 - start)
    assert sum(outcome.statuses.values()) == 5 * N_FRAMES
    assert outcome.judged == (None if outside == 0 else (FIRST + start, FIRST + last))
    for gap in outcome.gaps:
        assert start <= gap.start < gap.stop <= last + 1


def test_a_gap_across_the_border_is_filled_inside_as_in_the_whole_take(tmp_path):
    path = store(tmp_path, [(frame, 2) for frame in range(20, 40)])
    _, output = repaired(path)
    whole = formats.read(output).positions
    outcome, output = repaired(path, frames=f"{FIRST + 30}:")
    part = formats.read(output)
    (gap,) = outcome.gaps
    assert (gap.start, gap.stop, gap.n_filled) == (30, 40, 10)
    assert np.array_equal(part.positions[30:40], whole[30:40])
    assert not part.trusted[20:30, 2].any()
    assert outcome.counts.missing == outcome.counts.filled == 10


def test_the_frames_outside_are_learnt_from(tmp_path):
    """The error in a range is clearly less than that in a file that holds the range alone."""
    source, span = SAMPLES / "walk.c3d", slice(199, 260)
    take, truth = formats.read(source), formats.read(SAMPLES / "walk_truth.c3d").positions[span]
    formats.write(take.crop(span.start, span.stop), tmp_path / "part.c3d")
    gaps = ~take.trusted[span]

    def error(path, frames=None):
        outcome = repair(path, tmp_path / "out.c3d", resolve(None, {**QUICK, "method": "kriging", "frames": frames}))
        assert outcome.counts.filled == gaps.sum()
        found = formats.read(tmp_path / "out.c3d").positions
        return np.square((found if len(found) == len(truth) else found[span]) - truth)[gaps].mean() ** 0.5

    assert error(source, "200:260") < 0.7 * error(tmp_path / "part.c3d")


def test_a_limit_on_gaps_counts_the_whole_gap(tmp_path):
    path = store(tmp_path, [(frame, 2) for frame in range(20, 40)])
    outcome, _ = repaired(path, frames=f"{FIRST + 30}:", max_gap=15)
    assert outcome.statuses[Status.TOO_LONG] == 10


def test_exchanged_labels_are_put_back_inside_alone(tmp_path):
    path = tmp_path / "take.c3d"
    walked = perform("walk", 2.0, 120.0, 0).markers
    c3d.create(inject(walked, np.random.default_rng(1), ["swap"]).take, path)
    before = formats.read(path)
    whole, output = repaired(path, fix_swaps=True, overwrite=True)
    moved = np.flatnonzero((formats.read(output).positions != before.positions).any(axis=(1, 2)))
    assert whole.counts.moved == 2 * len(moved) > 2
    middle = int(moved[len(moved) // 2])
    part, output = repaired(path, fix_swaps=True, frames=f"{before.first_frame + middle}:")
    after = formats.read(output)
    assert part.counts.moved == part.statuses[Status.MOVED] == 2 * (moved >= middle).sum() < whole.counts.moved
    assert np.array_equal(before.positions[:middle], after.positions[:middle])
    assert (before.positions[middle] != after.positions[middle]).any()


def test_lines_of_other_frames_keep_their_bytes(tmp_path):
    spans = tmp_path / "bad.csv"
    spans.write_text("Spine1,100,140\n")
    output = tmp_path / "out.bvh"
    outcome = repair(
        SAMPLES / "walk.bvh", output, resolve(None, {"gaps": str(spans), "frames": ":120", "self_check": False})
    )
    assert outcome.status == "repaired", outcome.error
    old, new = ((path.read_bytes().splitlines(keepends=True)) for path in (SAMPLES / "walk.bvh", output))
    head = next(k for k, line in enumerate(old) if line.startswith(b"Frame Time")) + 1
    different = [k - head + 1 for k, (one, other) in enumerate(zip(old, new, strict=True)) if one != other]
    assert different
    assert set(different) <= set(range(1, 121))


def test_inspection_and_check_judge_the_frames_alone(tmp_path):
    path = store(tmp_path, [(frame, 2) for frame in range(5, 15)])
    assert inspect(path, resolve(None, {"frames": f"{FIRST + 20}:"})).counts.missing == 0
    assert inspect(path, resolve(None, {"frames": f":{FIRST + 9}"})).counts.missing == 5
    limits = {"check": {"longest_gap": 5, "missing": 50}}
    assert not CheckTake(resolve(None, limits))(path).passes
    verdict = CheckTake(resolve(None, {**limits, "frames": f"{FIRST + 20}:{FIRST + 39}"}))(path)
    assert verdict.passes
    assert (verdict.judged, verdict.measures["missing"]) == ((FIRST + 20, FIRST + 39), 0.0)
    assert verdict.measures["duration"] == pytest.approx(0.2)
    assert CheckTake(resolve(None, {**limits, "frames": f":{FIRST + 9}"}))(path).measures["longest_gap"] == 5


def test_the_view_of_a_check_is_rebuilt(tmp_path):
    path = store(tmp_path, [(frame, 2) for frame in range(5, 15)])
    chosen = resolve(None, {"frames": f"{FIRST + 10}:{FIRST + 39}", "check": {"longest_gap": 2}})
    views = []
    verdict = CheckTake(chosen, lambda _, view: views.append(view))(path)
    row = record.verdict_row(verdict)
    (finding,) = row["findings"]
    assert (finding["first"], finding["last"]) == (FIRST + 5, FIRST + 14)
    (breach,) = row["breaches"]
    assert f"({FIRST + 10}-{FIRST + 14})" in breach["message"]
    found = rebuilt_view(row, chosen.as_json(), path, None, None)
    assert np.array_equal(found.codes, views[0].codes)
    assert (found.codes == Status.MISSING).sum() == 5


def test_events_name_a_cycle(tmp_path):
    path = store(tmp_path, [(45, 1)], events())
    outcome, _ = repaired(path, events="left foot strike : Left Foot Strike")
    # Time t is in frame t * 100 + 1.
    assert outcome.judged == (11, 41)
    assert not outcome.counts.missing
    outcome, _ = repaired(path, events="Left Foot Off:Left Foot Strike")
    assert outcome.judged == (26, 41)
    assert not outcome.counts.missing


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frames": "1:5"}, "--frames must name frames of the take, 11 to 70. Got 1:5."),
        ({"frames": "71:"}, "11 to 70"),
        ({"events": "Right Foot Off:Left Foot Off"}, "it has: Left Foot Strike (2), Left Foot Off (1)"),
        ({"events": "Left Foot Off:Left Foot Off"}, "must follow the first 'Left Foot Off', in frame 26"),
    ],
)
def test_a_range_that_is_not_there_is_told_with_what_there_is(tmp_path, options, message):
    outcome = repair(store(tmp_path, (), events()), tmp_path / "out.c3d", resolve(None, options))
    assert (outcome.status, outcome.exit_code) == ("failed", 2)
    assert message in outcome.error
    assert not (tmp_path / "out.c3d").exists()


def test_a_file_without_events_says_so(tmp_path):
    outcome = repair(store(tmp_path), tmp_path / "out.c3d", resolve(None, {"events": "A:B"}))
    assert "--events must go with a file that has events. It has none." in outcome.error


@given(st.one_of(st.none(), st.integers()), st.one_of(st.none(), st.integers()))
def test_limits_are_read_as_they_are_written(first, last):
    text = f"{'' if first is None else first}:{'' if last is None else last}"
    if (first is None and last is None) or (first is not None and last is not None and first > last):
        with pytest.raises(ValueError, match="first:last"):
            frame_limits(text)
    else:
        assert frame_limits(text) == (first, last)


@pytest.mark.parametrize("text", ["", "5", "5-9", "a:b", ":", "9:2", "1:2:3"])
def test_other_texts_are_no_range(text):
    with pytest.raises(ConfigError, match="frames must be first:last"):
        resolve(None, {"frames": text})


def test_a_range_is_given_once_and_also_in_yaml(tmp_path):
    path = tmp_path / "studio.yaml"
    path.write_text("frames: 100:400\n", encoding="utf-8")
    assert resolve(path, {}).frames == "100:400"
    with pytest.raises(ConfigError, match="frames and events"):
        resolve(path, {"events": "A:B"})
    with pytest.raises(ConfigError, match="two names of events"):
        resolve(None, {"events": "A"})
    assert event_names(" A : B:C ") == ("A", "B:C")


def test_the_report_names_the_frames_and_the_view_is_rebuilt(tmp_path):
    path = store(tmp_path, [(frame, 2) for frame in range(20, 40)])
    views = []
    chosen = resolve(None, {**QUICK, "frames": f"{FIRST + 30}:"})
    outcome = repair(path, tmp_path / "out.c3d", chosen, None, views.append)
    row = record.row(outcome)
    assert row["judged_frames"] == {"first": FIRST + 30, "last": FIRST + N_FRAMES - 1}
    jsonschema.validate(json.loads("".join(record.text([row], chosen.as_json()))), SCHEMA)
    found = rebuilt_view(row, chosen.as_json(), path, tmp_path / "out.c3d", None)
    assert np.array_equal(found.codes, views[0].codes)


def test_the_command_says_which_frames_it_means(tmp_path):
    path = store(tmp_path, [(frame, 2) for frame in range(20, 40)])
    code, out, _ = run("fill", path, "--frames", f"{FIRST + 30}:", "--method", "linear")
    assert code == 0
    assert f"frames      {FIRST + 30}-70 alone; the 150 samples outside stay as they are and are not counted" in out
    assert "10 samples by linear" in out
    _, out, _ = run("inspect", path, "--frames", f"{FIRST + 20}:{FIRST + 39}")
    assert "20  100.0 %" in out
