"""The rules: the faults that each must find, the samples that none may distrust, and their common decision."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mocapclean.detection import RULES, _united, detect
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.prediction import predict
from mocapclean.detection.steps import LEAST_SCORE
from mocapclean.formats import c3d, read, write
from mocapclean.geometry.distances import rigidity
from mocapclean.geometry.skeleton import move
from mocapclean.pipeline.fill import fill
from mocapclean.simulate import inject, perform
from mocapclean.take import Finding, Take

ON = tuple(
    name
    for name, module in RULES.items()
    if getattr(module.Params(), "enabled", True) and "markers" in getattr(module, "COLUMNS", ("markers",))
)
FINDS = {"swap": "swap", "frozen": "frozen", "drift": "drift", "flicker": "flicker", "spike": "spike", "jump": "jump"}


@pytest.fixture(scope="module")
def box():
    """Markers of five seconds of boxing at 120 Hz, all trusted."""
    return perform("boxing", 5.0, 120.0, 2).markers


@pytest.fixture(scope="module")
def joints():
    """The joints of the same boxing, whose bones keep their length."""
    boxing = perform("boxing", 5.0, 120.0, 2)
    positions = move(boxing.asf, boxing.asf_poses).positions
    trusted = np.ones(positions.shape[:2], dtype=bool)
    return Take(positions=positions, trusted=trusted, markers=boxing.asf.names, rate=120.0)


@pytest.fixture(scope="module")
def broken():
    """Markers of five seconds of walking with an event of each kind for 10,000 samples, twice the smallest size."""
    return inject(perform("walk", 5.0, 120.0, 2).markers, np.random.default_rng(4), size=2.0)


@pytest.fixture(scope="module")
def evidence(broken):
    """The evidence of the faulty walk, shared by the tests."""
    return Evidence(broken.take)


def ruled(take, name):
    return RULES[name].examine(Evidence(take), RULES[name].Params())


def found_events(injected, distrusted, kind):
    events = [event for event in injected.events if event.kind == kind]
    return sum(distrusted[injected.samples(event)].mean() >= 0.5 for event in events), len(events)


def moved(take, **arrays):
    return Take(
        **{"positions": take.positions, "trusted": take.trusted, **arrays}, markers=take.markers, rate=take.rate
    )


@pytest.mark.parametrize("motion", ["walk", "boxing"])
@pytest.mark.parametrize("rate", [50.0, 120.0, 400.0])
def test_clean_takes_are_trusted_at_any_rate(motion, rate):
    take = perform(motion, 2.0, rate, 0).markers
    assert (~detect(take).trusted).sum() <= 1e-4 * take.trusted.size


@pytest.mark.parametrize("name", [name for name in ON if name != "missing"])
def test_a_rule_names_what_it_distrusts_and_nothing_else(broken, evidence, name):
    distrusted, findings = RULES[name].examine(evidence, RULES[name].Params())
    named = np.zeros_like(distrusted)
    for finding in findings:
        assert finding.rule == name
        assert finding.message
        assert finding.advice
        if not finding.suspicion:
            named[slice(*finding.frames), broken.take.markers.index(finding.marker)] = True
    np.testing.assert_array_equal(named & broken.take.trusted, distrusted)
    assert not (distrusted & ~broken.take.trusted).any()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "swap",
            r"carries the label of \w+ for \d+ frames?: distances .* \d+\.\d robust SDs off, exchanged back \d+\.\d",
        ),
        ("frozen", r"holds still for \d+ frames while its predicted position moves \d+ mm"),
        ("drift", r"sits \d+ mm \(\d+ standard errors\) from its place in its segment (up to here|from here on)"),
        ("flicker", r"flickers for \d+ frames"),
        ("spike", r"up to \d+ mm off its path for (1 frame|[23] frames), \d+\.\d times the threshold"),
        ("jump", r"up to \d+ mm off its path for \d+ frames, \d+\.\d times the threshold"),
        ("predict", r"up to \d+ mm from its predicted position for \d+ frames?"),
        ("tdd", r"not reachable from the rest of its path at 60 mm per frame for \d+ frames?|moves \d+ mm within .*"),
    ],
)
def test_a_message_gives_size_and_duration(evidence, name, message):
    _, findings = RULES[name].examine(evidence, RULES[name].Params())
    assert findings
    for finding in findings:
        assert re.fullmatch(message, finding.message)


@pytest.mark.parametrize("name", FINDS)
def test_each_kind_of_fault_has_its_rule(broken, evidence, name):
    distrusted, _ = RULES[name].examine(evidence, RULES[name].Params())
    hits, events = found_events(broken, distrusted, FINDS[name])
    assert events
    assert hits == events


@pytest.mark.parametrize("rate", [50.0, 240.0])
def test_all_rules_find_small_faults_at_other_rates(rate):
    injected = inject(perform("walk", 4.0, rate, 1).markers, np.random.default_rng(0))
    distrusted = ~detect(injected.take, replace="suspicious").trusted
    hits = [found_events(injected, distrusted, kind) for kind in FINDS]
    assert sum(hit for hit, _ in hits) >= 0.9 * sum(events for _, events in hits)
    near = injected.faulty.copy()
    for shift in (1, 2):
        near[shift:] |= injected.faulty[:-shift]
        near[:-shift] |= injected.faulty[shift:]
    assert (distrusted & injected.faulty).sum() >= 0.95 * (distrusted & (injected.faulty | ~near)).sum()


def test_where_the_world_lies_does_not_matter(box):
    broken = inject(box.crop(0, 250), np.random.default_rng(1))
    turn = Rotation.from_euler("zyx", [40, 10, -20], degrees=True).as_matrix()
    turned = moved(broken.take, positions=broken.take.positions @ turn.T + [4000.0, -300.0, 90.0])
    assert (detect(turned).trusted != detect(broken.take).trusted).sum() <= 3


def test_what_is_missing_is_never_read(box):
    box = box.crop(0, 250)
    trusted = np.random.default_rng(8).random(box.trusted.shape) > 0.03
    low, high = (
        detect(moved(box, positions=np.where(trusted[..., None], box.positions, junk), trusted=trusted))
        for junk in (-1e7, 1e7)
    )
    np.testing.assert_array_equal(low.trusted, high.trusted)
    assert not (low.trusted & ~trusted).any()


@pytest.mark.parametrize(("n_frames", "n_markers"), [(1, 1), (2, 5), (3, 12), (9, 4), (40, 2)])
def test_tiny_takes_are_answered(box, n_frames, n_markers):
    take = box.crop(0, n_frames).select(np.arange(n_markers))
    assert detect(take).trusted.shape == (n_frames, n_markers)
    assert detect(moved(take, trusted=np.zeros_like(take.trusted))).trusted.sum() == 0


def test_rules_can_be_switched_off_by_name(box):
    positions = box.positions[:100].copy()
    positions[50, 7] += 200.0
    take = moved(box.crop(0, 100), positions=positions)
    assert {f.rule for f in detect(take).findings} == {"spike"}
    off = {name: RULES[name].Params(**({"enabled": False} if name == "spike" else {})) for name in ON}
    assert "spike" not in {f.rule for f in detect(take, off).findings}


@pytest.mark.parametrize(("factor", "reported"), [(1.0, False), (0.001, True), (1 / 25.4, True), (10.0, True)])
def test_wrong_units_are_reported_and_nothing_is_distrusted(box, factor, reported):
    distrusted, findings = ruled(moved(box, positions=box.positions * factor), "units")
    assert bool(findings) == reported
    assert not distrusted.any()


def test_a_sample_that_no_unit_explains_is_distrusted_and_changes_no_other_finding(box):
    positions = box.positions.copy()
    positions[100:103, 4] = 1e30
    positions[250, 7] = [0.0, -1e12, 0.0]
    broken = np.zeros(box.trusted.shape, dtype=bool)
    broken[100:103, 4] = broken[250, 7] = True
    distrusted, findings = ruled(moved(box, positions=positions), "units")
    assert np.array_equal(distrusted, broken)
    assert [finding.frames for finding in findings if finding.marker] == [(100, 103), (250, 251)]
    taken = detect(moved(box, positions=positions))
    assert np.array_equal(~taken.trusted & box.trusted, broken | (~detect(box).trusted & box.trusted))


def test_bones_find_a_marker_that_slowly_leaves(box):
    positions = box.positions.copy()
    marker = box.markers.index("LFHD")
    positions[200:250, marker] += 90 * np.sin(np.linspace(0, np.pi, 50))[:, None] * [0.0, 0.6, 0.8]
    distrusted, _ = ruled(moved(box, positions=positions), "bone")
    assert distrusted[220:230, marker].all()
    assert not np.delete(distrusted, marker, axis=1).any()


def test_prediction_finds_it_too(box):
    positions = box.positions.copy()
    marker = box.markers.index("LTHI")
    positions[200:250, marker] += 90 * np.sin(np.linspace(0, np.pi, 50))[:, None] * [0.0, 0.6, 0.8]
    distrusted, _ = ruled(moved(box, positions=positions), "predict")
    assert distrusted[215:235, marker].all()
    assert not np.delete(distrusted, marker, axis=1).any()


def test_prediction_judges_no_frame_with_too_few_partners_in_sight(box):
    marker = box.markers.index("LTHI")
    partners, weights = Evidence(box).rigid.partners(marker)
    n_hidden = 1 + int(np.searchsorted(np.cumsum(weights), 0.55 * weights.sum()))
    positions, trusted = box.positions.copy(), box.trusted.copy()
    positions[200:250, [marker]] += 90 * np.sin(np.linspace(0, np.pi, 50))[:, None, None] * [0.0, 0.6, 0.8]
    assert ruled(moved(box, positions=positions), "predict")[0][:, marker].any()
    trusted[222:228, partners[:n_hidden]] = False
    distrusted, _ = ruled(moved(box, positions=positions, trusted=trusted), "predict")
    assert distrusted[216:222, marker].all()
    assert not distrusted[222:228].any()


def test_prediction_leaves_a_limb_that_moves_as_never_before(box):
    positions = box.positions.copy()
    arm = [box.markers.index(name) for name in ("LELB", "LFRM", "LWRA", "LWRB", "LFIN")]
    waves = np.sin(np.linspace(0, np.pi, 30)[:, None] * np.arange(1, 6))
    away = np.random.default_rng(0).normal(size=(5, len(arm), 3))
    away *= 250.0 / np.linalg.norm(away, axis=(0, 2), keepdims=True)
    positions[200:230, arm] += np.einsum("fk,kmc->fmc", waves, away)
    distrusted, _ = ruled(moved(box, positions=positions), "predict")
    assert distrusted.sum() <= 0.1 * 30 * len(arm)


@pytest.mark.parametrize(("start", "stop"), [(30, 115), (12, 100), (60, 142)])
def test_an_excursion_is_the_jump_even_if_it_lasts_longer_than_the_rest(box, start, stop):
    take = box.crop(0, 160)
    positions, marker = take.positions.copy(), box.markers.index("LTHI")
    positions[start:stop, marker] += [0.0, 96.0, -128.0]
    distrusted = ~detect(moved(take, positions=positions), replace="suspicious").trusted
    assert distrusted[start:stop, marker].all()
    assert np.count_nonzero(distrusted) <= stop - start + 4


def test_rigid_pairs_distinguish_a_drift_from_its_side_effects(joints):
    injected = inject(joints, np.random.default_rng(8), ["drift"], rate=1e-9, size=4.0)
    (event,) = injected.events
    distrusted, (finding,) = ruled(injected.take, "drift")
    assert finding.marker == joints.markers[event.markers[0]]
    assert (distrusted & injected.faulty).sum() >= 0.9 * injected.faulty.sum()


def test_a_slide_is_part_of_the_drift(box):
    positions = box.positions.copy()
    marker = box.markers.index("LTHI")
    share = np.clip((np.arange(len(positions)) - 300) / 60, 0.0, 1.0)
    positions[:, marker] += share[:, None] * [0.0, 48.0, 64.0]
    distrusted, _ = ruled(moved(box, positions=positions), "drift")
    assert distrusted[315:, marker].all()
    assert not distrusted[:300].any()


def test_noise_in_one_direction_hides_no_drift_in_another(box):
    marker, time = box.markers.index("LTHI"), np.arange(len(box.positions))
    noise = sum(np.sin(2 * np.pi * time / period + phase) for period, phase in ((47, 0.3), (71, 1.1), (113, 2.0)))
    noisy = box.positions.copy()
    noisy[:, marker] += 3.0 * noise[:, None] * [0.0, 0.0, 1.0]
    scores = []
    for direction in ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]):
        positions = noisy.copy()
        positions[300:, marker] += 40.0 * np.array(direction)
        only = np.arange(len(box.markers)) == marker
        (step,) = predict(positions, box.trusted, rigidity(positions, box.trusted), slide=60, only=only).steps
        assert step.start == 300
        scores.append(step.score)
    assert scores[0] >= 1.5 * scores[1]


@pytest.mark.parametrize(("name", "size"), [("LTHI", 1.6), ("RFHD", 1.2)])
def test_agreeing_distances_lower_the_score_that_a_drift_needs(box, name, size):
    positions, marker = box.positions.copy(), box.markers.index(name)
    time = np.arange(len(positions))[:, None]
    noise = sum(np.sin(2 * np.pi * time / period + period * np.arange(1, 4)) for period in (47, 71, 113))
    share = np.clip((time - 300) / 50, 0.0, 1.0)
    positions[:, marker] += size * noise + 20.0 * share * [0.0, 0.6, 0.8]
    (step,) = Evidence(moved(box, positions=positions)).analysis.steps
    assert step.distances_agree
    assert step.score < LEAST_SCORE
    assert ruled(moved(box, positions=positions), "drift")[0][350:, marker].all()


@pytest.mark.parametrize(
    ("name", "n_frames"),
    # Not the left foot in 170 frames: it stands there to a hundredth of a millimetre, and no segment of it shows.
    [("thorax", 170), ("thorax", 250), ("lradius", 170), ("lradius", 250), ("lfoot", 250)],
)
def test_rigid_pairs_show_a_drift_near_the_end_of_a_short_take(joints, name, n_frames):
    take = joints.crop(0, n_frames)
    positions, marker = take.positions.copy(), take.markers.index(name)
    share = np.clip((np.arange(n_frames) - n_frames + 45) / 20, 0.0, 1.0)
    positions[:, marker] += share[:, None] * [10.0, 10.0, 14.0]
    distrusted, _ = ruled(moved(take, positions=positions), "drift")
    assert distrusted[-30:, marker].all()
    assert not np.delete(distrusted, marker, axis=1).any()


@pytest.mark.parametrize(
    ("name", "jump", "start"), [("LTHI", (250, 290), 340), ("LSHO", (220, 280), 380), ("RFHD", (250, 300), 360)]
)
def test_a_jump_shortly_before_hides_no_drift(box, name, jump, start):
    positions, marker = box.positions.copy(), box.markers.index(name)
    positions[slice(*jump), marker] += [0.0, 24.0, -32.0]
    positions[start:, marker] += [0.0, 16.0, 12.0]
    distrusted, _ = ruled(moved(box, positions=positions), "drift")
    assert distrusted[start:, marker].all()
    assert not distrusted[:start].any()


def test_a_slide_is_drift_from_its_beginning(joints):
    take = joints.crop(0, 480)
    positions, marker = take.positions.copy(), take.markers.index("thorax")
    share = np.clip((np.arange(480) - 240) / 55, 0.0, 1.0)
    positions[:, marker] += share[:, None] * [40.0, 40.0, 56.0]
    distrusted, _ = ruled(moved(take, positions=positions), "drift")
    assert distrusted[250:, marker].all()
    assert not distrusted[:240].any()


@pytest.mark.parametrize("n_frames", [420, 480])
def test_a_guard_that_is_held_is_no_rigid_pair(joints, n_frames):
    assert detect(joints.crop(0, n_frames)).trusted.all()


@pytest.mark.parametrize(("name", "first"), [("lclavicle", 250), ("rclavicle", 250), ("rclavicle", 215)])
def test_a_faulty_partner_hides_no_drift_that_changes_other_rigid_pairs(joints, name, first):
    take = joints.crop(0, 360)
    positions, marker = take.positions.copy(), take.markers.index("thorax")
    positions[first:340, take.markers.index(name)] += [-90.0, 90.0, 100.0]
    share = np.clip((np.arange(360) - 262) / 33, 0.0, 1.0)
    positions[:, marker] += share[:, None] * [40.0, 40.0, 56.0]
    distrusted, _ = ruled(moved(take, positions=positions), "drift")
    assert distrusted[295:, marker].all()
    assert not np.delete(distrusted, marker, axis=1).any()


def test_outliers_are_the_sparse_part_of_a_low_rank_model(box):
    take = box.crop(0, 60).select(np.arange(12))
    positions = take.positions.copy()
    positions[30:35, 3] += 300.0
    rule = RULES["outlier"]
    assert not rule.Params().enabled
    distrusted, findings = rule.examine(Evidence(moved(take, positions=positions)), rule.Params(sparsity=5.0))
    assert distrusted[30:35, 3].all()
    assert {finding.rule for finding in findings} == {"outlier"}


def test_two_rules_about_one_span_give_one_finding():
    one = Finding(rule="jump", message="off its path", marker="A", frames=(10, 40))
    same = Finding(rule="bone", message="too far", marker="A", frames=(12, 42))
    other = Finding(rule="bone", message="too far", marker="B", frames=(12, 42))
    inside = Finding(rule="bone", message="too far", marker="A", frames=(20, 25))
    united = _united([one, same, other, inside])
    assert [(f.rule, f.marker, f.frames) for f in united] == [
        ("jump", "A", (10, 42)),
        ("bone", "B", (12, 42)),
        ("bone", "A", (20, 25)),
    ]
    assert united[0].message == "off its path; also found by bone"


def test_swaps_are_put_back_to_the_last_bit(box):
    injected = inject(box, np.random.default_rng(3), ["swap"], rate=2.0)
    fixed = detect(injected.take, fix_swaps=True)
    np.testing.assert_array_equal(fixed.positions, box.positions)
    np.testing.assert_array_equal(fixed.moved, injected.faulty)
    told = np.zeros_like(fixed.moved)
    for pair in fixed.exchanged:
        told[pair.start : pair.stop, [box.markers.index(pair.first), box.markers.index(pair.second)]] = True
    np.testing.assert_array_equal(told, injected.faulty)
    assert fixed.trusted.all()
    assert detect(injected.take).suspicious[injected.faulty].all()
    assert not detect(injected.take, replace="suspicious").trusted[injected.faulty].any()


def test_a_file_with_swaps_put_back_holds_the_original_numbers(box, tmp_path):
    injected = inject(box, np.random.default_rng(3), ["swap"], rate=2.0)
    c3d.create(box, tmp_path / "truth.c3d")
    c3d.create(injected.take, tmp_path / "take.c3d")
    fixed = fill(detect(read(tmp_path / "take.c3d"), fix_swaps=True), method="linear").take
    assert fixed.moved.any()
    write(fixed, tmp_path / "fixed.c3d")
    assert (tmp_path / "fixed.c3d").read_bytes() == (tmp_path / "truth.c3d").read_bytes()


def test_real_captures_are_mostly_trusted(captures):
    folder = captures / "c3d"
    for name in ("nimblephysics__c3d_cmu_dribble_shoot_basketball", "BTKData__PiG_PiG_Motion3_FF_N18"):
        take = read(folder / f"{name}.c3d")
        assert (take.trusted & ~detect(take).trusted).sum() <= 1e-3 * take.trusted.sum()


def test_a_swap_in_a_real_capture_is_found(captures):
    take = detect(read(captures / "c3d" / "nimblephysics__ComplexKnee_2022_01_0403.c3d"))
    assert {f.marker for f in take.findings if f.rule == "swap"} == {"LTH1", "LTH2"}
    assert replace(take).findings
