"""Trust rules against faults that are known because they were put in (``simulate.inject``), and on takes as they are.

A row is one take with one set of rules. ``all`` is what ``detect`` runs by default; ``tdd`` and the other rules run by
themselves; ``hampel`` is the Hampel filter of the textbooks; ``truth`` knows the faults. An event is found when at
least half of its samples are distrusted; samples within 2 frames of a fault count as neither right nor wrong. The fill
is measured with the first seed only, for it takes longest. Rules by themselves share the evidence of a take: its time
is in the seconds of the first of them.
"""

from dataclasses import replace
from functools import lru_cache, partial
from time import perf_counter

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mocapclean.arrays import Bools, Floats
from mocapclean.config.settings import DEFAULT_METHOD
from mocapclean.detection import RULES, detect
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rules import swap
from mocapclean.experiments.jobs import Capture, Choice, Entry, Found, Job, rms, solve
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Table, number
from mocapclean.numerics.robust import nan_median
from mocapclean.simulate import FAULTS, Injected, inject
from mocapclean.take import Take

SIZES = (1, 2, 4)
ALONE = tuple(name for name, module in RULES.items() if name not in ("missing", "units") and module.Params().enabled)
EVERYWHERE = ("all", "tdd", "hampel", "truth")
SETS = (*EVERYWHERE, *(name for name in ALONE if name not in EVERYWHERE))
MEASURES = (
    *(f"{kind} {what}" for kind in FAULTS for what in ("events", "found")),
    "samples",
    "faulty",
    "right",
    "wrong",
    "wrong_anew",
    "swaps_exact",
    "rmse",
    "seconds",
)
QUICK_FRAMES = 600
_MARGIN = 2
_HALF_WINDOW, _SIGMAS = 5, 3.0


def jobs(choice: Choice) -> list[Job]:
    """Every set of rules on every take: as it is, and with faults of every size; single rules with the smallest."""
    entries = choice.entries([Entry(method=DEFAULT_METHOD)])
    sizes = (0, SIZES[0]) if choice.quick else (0, *SIZES)
    return [
        Job(
            take=capture.name,
            source=capture.digest,
            entry=replace(entry, variant=rules),
            cell={"size": str(size)},
            seed=seed,
            run=partial(run, capture, entry, rules, size, seed),
        )
        for capture in choice.shortened(QUICK_FRAMES).captures
        for size in sizes
        for seed in range(choice.n_seeds if size else 1)
        for rules in (SETS if size <= SIZES[0] and not choice.quick else EVERYWHERE)
        for entry in entries
        if size or rules != "truth"
    ]


def run(capture: Capture, entry: Entry, rules: str, size: int, seed: int) -> Found:
    """What a set of rules finds of the faults, what it distrusts besides, and the error that is left after the fill."""
    clean, (scene, evidence) = capture.take, _scene(capture, size, seed)
    begin = perf_counter()
    distrusted = _distrusted(scene, evidence, rules)
    seconds = perf_counter() - begin
    near = _widened(scene.faulty)
    measures: dict[str, float | int] = {
        "samples": int(clean.trusted.sum()),
        "faulty": int(scene.faulty.sum()),
        "right": int((distrusted & scene.faulty).sum()),
        "wrong": int((distrusted & ~near).sum()),
        "seconds": seconds,
    }
    if size == 0:
        return measures, {}
    measures["wrong_anew"] = int((distrusted & ~near & ~_natural(capture, rules)).sum())
    for kind in FAULTS:
        events = [event for event in scene.events if event.kind == kind]
        shares = [float(distrusted[scene.samples(event)].mean()) for event in events]
        measures |= {f"{kind} events": len(events), f"{kind} found": sum(share >= 0.5 for share in shares)}
    if rules == "all":
        measures["swaps_exact"] = _exact(clean, scene)
    if seed == 0:
        measures["rmse"] = _error(clean, scene, distrusted, entry)
    return measures, {}


@lru_cache(maxsize=2)
def _scene(capture: Capture, size: int, seed: int) -> tuple[Injected, Evidence]:
    """A take with its faults, none for size 0, and the evidence for rules by themselves."""
    if size == 0:
        scene = Injected(take=capture.take, faulty=np.zeros_like(capture.take.trusted), events=())
    else:
        scene = inject(capture.take, np.random.default_rng([seed, size]), size=size)
    return scene, Evidence(scene.take)


@lru_cache(maxsize=len(SETS))
def _natural(capture: Capture, label: str) -> Bools:
    """The samples (F, M) that a set of rules distrusts in the take as it is."""
    return _distrusted(*_scene(capture, 0, 0), label)


def _distrusted(scene: Injected, evidence: Evidence, label: str) -> Bools:
    """The samples (F, M) that a set of rules distrusts."""
    take = scene.take
    if label == "truth":
        return scene.faulty
    if label == "hampel":
        return hampel(take.positions, take.trusted)
    if label == "all":
        return take.trusted & ~detect(take).trusted
    distrusted: Bools = RULES[label].examine(evidence, RULES[label].Params())[0]
    return take.trusted & distrusted


def hampel(positions: Floats, trusted: Bools) -> Bools:
    """The samples (F, M) with a coordinate more than 3 robust SDs from the median of the 11 frames around it.

    R. K. Pearson, 2002, doi:10.1109/87.974338, as it stands, for each coordinate.
    """
    known = np.where(trusted[..., None], positions, np.nan)
    padded = np.pad(known, ((_HALF_WINDOW, _HALF_WINDOW), (0, 0), (0, 0)), constant_values=np.nan)
    windows = sliding_window_view(padded, 2 * _HALF_WINDOW + 1, axis=0)
    middle = nan_median(windows, axis=-1)
    spread = 1.4826 * nan_median(np.abs(windows - middle[..., None]), axis=-1)
    return np.asarray(trusted & (np.abs(known - middle) > _SIGMAS * spread).any(axis=2))


def _widened(mask: Bools) -> Bools:
    wide = mask.copy()
    for shift in range(1, _MARGIN + 1):
        wide[shift:] |= mask[:-shift]
        wide[:-shift] |= mask[shift:]
    return wide


def _exact(clean: Take, scene: Injected) -> int:
    """The swaps of which every sample is again, to the last bit, what it was."""
    fixed = swap.undo(Evidence(scene.take), swap.Params())
    same = (fixed.positions == clean.positions).all(axis=2) & fixed.trusted
    return sum(bool(same[scene.samples(event)].all()) for event in scene.events if event.kind == "swap")


def _error(clean: Take, scene: Injected, distrusted: Bools, entry: Entry) -> float:
    """The RMSE per coordinate, mm, of the faulty samples after what is distrusted has been filled."""
    solution, _ = solve(scene.take, distrusted, entry)
    filled = distrusted & solution.filled
    positions = np.where(filled[..., None], solution.positions, scene.take.positions)
    return rms((positions - clean.positions)[scene.faulty])


def _total(results: Results, measure: str) -> float:
    return sum(row.values.get(measure, 0.0) for row in results.rows)


def _share(part: float, whole: float) -> str:
    return f"{100 * part / whole:.1f}" if whole else "-"


def tables(results: Results) -> list[Table]:
    """Events found, samples right and wrong, errors, by set of rules and size; what is distrusted in takes as is."""
    header = (
        "rules",
        "size",
        *(f"{kind} %" for kind in FAULTS),
        "right %",
        "right, new %",
        "swaps exact %",
        "RMSE",
        "/ truth",
    )
    rows = []
    for label in results.labels:
        for (size,) in results.cells("size"):
            mine = results.where(label=label, size=size)
            if size == "0" or not mine.rows:
                continue
            right = _total(mine, "right")
            truth = results.where(label=f"{mine.rows[0].method} truth", size=size)
            swaps = _total(mine, "swap events") if any("swaps_exact" in row.values for row in mine.rows) else 0
            rows.append(
                (
                    label,
                    size,
                    *(_share(_total(mine, f"{kind} found"), _total(mine, f"{kind} events")) for kind in FAULTS),
                    _share(right, right + _total(mine, "wrong")),
                    _share(right, right + _total(mine, "wrong_anew")),
                    _share(_total(mine, "swaps_exact"), swaps),
                    number(_pooled(mine)),
                    number(_ratio(mine, truth)),
                )
            )
    return [
        Table(
            title="Events found, distrusted samples that are faulty, RMSE of the faulty samples, mm",
            header=header,
            rows=tuple(rows),
        ),
        _untouched(results),
    ]


def _untouched(results: Results) -> Table:
    """Distrusted samples for each 100,000 of each take as it is."""
    labels = [label for label in results.labels if results.where(label=label, size=0).rows]
    rows = [
        (take, *(number(_rate(results.where(take=take, label=label, size=0))) for label in labels))
        for take in results.takes
    ]
    known = [[_rate(results.where(take=take, label=label, size=0)) for take in results.takes] for label in labels]
    medians = [number(float(np.median([v for v in values if v is not None]))) if values else "-" for values in known]
    return Table(
        title="Distrusted samples for each 100,000 of the takes as they are",
        header=("take", *labels),
        rows=(*rows, ("median", *medians)),
    )


def _rate(results: Results) -> float | None:
    samples = _total(results, "samples")
    return 1e5 * _total(results, "wrong") / samples if samples else None


def _pooled(results: Results) -> float | None:
    """The RMSE over the faulty samples of all rows."""
    known = [(row.values["rmse"], row.values["faulty"]) for row in results.rows if "rmse" in row.values]
    count = sum(n for _, n in known)
    return float(np.sqrt(sum(n * rmse**2 for rmse, n in known) / count)) if count else None


def _ratio(mine: Results, truth: Results) -> float | None:
    ours, best = _pooled(mine), _pooled(truth)
    return ours / best if ours is not None and best else None


def figures(results: Results) -> list[Figure]:
    """The share of events found over their size, one panel for each kind."""
    panels = []
    for kind in FAULTS:
        curves = []
        for label in results.labels:
            if label.split()[-1] not in ("all", "tdd", "hampel"):
                continue
            points = [
                (float(size), _total(mine, f"{kind} found") / max(_total(mine, f"{kind} events"), 1.0))
                for (size,) in results.cells("size")
                if size != "0"
                for mine in [results.where(label=label, size=size)]
                if mine.rows
            ]
            curves.append(Curve(label=label, x=[x for x, _ in points], y=[y for _, y in points]))
        panels.append(Panel(title=kind, x_label="size", y_label="share found", curves=tuple(curves), log_x=True))
    return [Figure(name="trust_found", title="Events found by size", panels=tuple(panels))]
