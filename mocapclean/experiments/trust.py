"""Trust rules on takes with simulated faults of known time, kind and size, and on takes as they are.

This experiment is from no paper; ``simulate.inject`` makes the faults. A row is one take with one set of rules. ``all``
is the default of ``detect``; ``tdd`` and the other rules run alone; ``hampel`` is the Hampel filter; ``truth`` is the
faults themselves. A sample is doubted if a finding names it, whether it is distrusted or a suspicion. An event is found
if at least half of its samples are doubted, and repaired if the defaults distrust half of them. Samples within 2 frames
of a fault count as neither right nor wrong. The error after a fill of all doubted samples is measured with the first
seed only, because the fill takes longest. Rules that run alone share the evidence of a take, whose time is in the
seconds of the first of them.
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
from mocapclean.experiments.experiment import Experiment
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Table, number
from mocapclean.experiments.trials import Capture, Entry, Request, Trial, TrialResult, rms, solve
from mocapclean.numerics.robust import MAD_TO_SD, nan_median
from mocapclean.simulate import FAULTS, Injected, inject
from mocapclean.take import Take

SIZES = (1, 2, 4)
"""Sizes of faults, in multiples of the sizes in ``simulate.faults``."""

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
    "repaired",
    "replaced",
    "replaced_wrong",
    "swaps_exact",
    "rmse",
    "seconds",
)
QUICK_FRAMES = 600
"""First frames of a take that --quick keeps; chosen by hand."""

_MARGIN = 2  # frames on both sides of a fault that count as neither right nor wrong; chosen by hand
_HALF_WINDOW = 5  # frames on both sides in the window of the Hampel filter; chosen by hand
_SIGMAS = 3.0  # robust SDs from the median; the 3-sigma rule of Pearson (2002)


def trials(request: Request) -> list[Trial]:
    """Return trials of all sets of rules, on takes as they are and with faults; single rules at the smallest size."""
    entries = request.entries([Entry(method=DEFAULT_METHOD)])
    sizes = (0, SIZES[0]) if request.quick else (0, *SIZES)
    return [
        Trial(
            take=capture.name,
            source=capture.digest,
            entry=replace(entry, variant=rules),
            cell={"size": str(size)},
            seed=seed,
            run=partial(run, capture, entry, rules, size, seed),
        )
        for capture in request.shortened(QUICK_FRAMES).captures
        for size in sizes
        for seed in range(request.n_seeds if size else 1)
        for rules in (SETS if size <= SIZES[0] and not request.quick else EVERYWHERE)
        for entry in entries
        if size or rules != "truth"
    ]


def run(capture: Capture, entry: Entry, rules: str, size: int, seed: int) -> TrialResult:
    """Return the events that a set of rules finds, its doubted samples, and the error after they are filled."""
    clean, (injected, evidence) = capture.take, _injected(capture, size, seed)
    begin = perf_counter()
    doubted = _doubted(injected, evidence, rules)
    seconds = perf_counter() - begin
    near = _widened(injected.faulty)
    measures: dict[str, float | int] = {
        "samples": int(clean.trusted.sum()),
        "faulty": int(injected.faulty.sum()),
        "right": int((doubted & injected.faulty).sum()),
        "wrong": int((doubted & ~near).sum()),
        "seconds": seconds,
    }
    if rules == "all":
        replaced = _replaced(injected.take)
        shares = [float(replaced[injected.samples(event)].mean()) for event in injected.events]
        measures |= {"replaced": int(replaced.sum()), "replaced_wrong": int((replaced & ~near).sum())}
        measures["repaired"] = sum(share >= 0.5 for share in shares)
    if size == 0:
        return measures, {}
    measures["wrong_anew"] = int((doubted & ~near & ~_natural(capture, rules)).sum())
    for kind in FAULTS:
        events = [event for event in injected.events if event.kind == kind]
        shares = [float(doubted[injected.samples(event)].mean()) for event in events]
        measures |= {f"{kind} events": len(events), f"{kind} found": sum(share >= 0.5 for share in shares)}
    if rules == "all":
        measures["swaps_exact"] = _exact(clean, injected)
    if seed == 0:
        measures["rmse"] = _error(clean, injected, doubted, entry)
    return measures, {}


@lru_cache(maxsize=2)
def _injected(capture: Capture, size: int, seed: int) -> tuple[Injected, Evidence]:
    """Return a take with faults (none for size 0), and the evidence for rules that run alone."""
    if size == 0:
        injected = Injected(take=capture.take, faulty=np.zeros_like(capture.take.trusted), events=())
    else:
        injected = inject(capture.take, np.random.default_rng([seed, size]), size=size)
    return injected, Evidence(injected.take)


@lru_cache(maxsize=len(SETS))
def _natural(capture: Capture, label: str) -> Bools:
    """Return the samples (F, M) that a set of rules doubts in the take as it is."""
    return _doubted(*_injected(capture, 0, 0), label)


def _replaced(take: Take) -> Bools:
    """Return the samples (F, M) that the defaults of ``detect`` distrust."""
    return np.asarray(take.trusted & ~detect(take).trusted)


def _doubted(injected: Injected, evidence: Evidence, label: str) -> Bools:
    """Return the samples (F, M) that a set of rules doubts."""
    take = injected.take
    if label == "truth":
        return injected.faulty
    if label == "hampel":
        return hampel(take.positions, take.trusted)
    if label == "all":
        found = detect(take)
        return np.asarray(take.trusted & (~found.trusted | found.suspicious))
    doubted: Bools = RULES[label].examine(evidence, RULES[label].Params())[0]
    return take.trusted & doubted


def hampel(positions: Floats, trusted: Bools) -> Bools:
    """Return the samples (F, M) with a coordinate more than 3 robust SDs from the median of its 11 frames.

    The Hampel filter of R. K. Pearson, 2002, doi:10.1109/87.974338, for each coordinate.
    """
    known = np.where(trusted[..., None], positions, np.nan)
    padded = np.pad(known, ((_HALF_WINDOW, _HALF_WINDOW), (0, 0), (0, 0)), constant_values=np.nan)
    windows = sliding_window_view(padded, 2 * _HALF_WINDOW + 1, axis=0)
    middle = nan_median(windows, axis=-1)
    spread = MAD_TO_SD * nan_median(np.abs(windows - middle[..., None]), axis=-1)
    return np.asarray(trusted & (np.abs(known - middle) > _SIGMAS * spread).any(axis=2))


def _widened(mask: Bools) -> Bools:
    """Return a mask (F, M) extended by ``_MARGIN`` frames to both sides."""
    wide = mask.copy()
    for shift in range(1, _MARGIN + 1):
        wide[shift:] |= mask[:-shift]
        wide[:-shift] |= mask[shift:]
    return wide


def _exact(clean: Take, injected: Injected) -> int:
    """Return the number of swaps whose repair restores every sample bit for bit."""
    fixed = swap.undo(Evidence(injected.take), swap.Params())
    same = (fixed.positions == clean.positions).all(axis=2) & fixed.trusted
    return sum(bool(same[injected.samples(event)].all()) for event in injected.events if event.kind == "swap")


def _error(clean: Take, injected: Injected, doubted: Bools, entry: Entry) -> float:
    """Return the RMSE per coordinate, mm, of the faulty samples after the doubted samples have been filled."""
    solution, _ = solve(injected.take, doubted, entry)
    filled = doubted & solution.filled
    positions = np.where(filled[..., None], solution.positions, injected.take.positions)
    return rms((positions - clean.positions)[injected.faulty])


def _total(results: Results, measure: str) -> float:
    """Return the sum of a measure over all rows."""
    return sum(row.values.get(measure, 0.0) for row in results.rows)


def _share(part: float, whole: float) -> str:
    """Return a share as text in percent; "-" of nothing."""
    return f"{100 * part / whole:.1f}" if whole else "-"


def tables(results: Results) -> list[Table]:
    """Return the table of events, precision and errors by set of rules and size, and that of takes as they are."""
    header = (
        "rules",
        "size",
        *(f"{kind} %" for kind in FAULTS),
        "repaired %",
        "right %",
        "right, new %",
        "swaps exact %",
        "RMSE",
        "/ truth",
    )
    rows = []
    for label in results.labels:
        for (size,) in results.cells("size"):
            subset = results.where(label=label, size=size)
            if size == "0" or not subset.rows:
                continue
            right = _total(subset, "right")
            truth = results.where(label=f"{subset.rows[0].method} truth", size=size)
            known = any("repaired" in row.values for row in subset.rows)
            events = sum(_total(subset, f"{kind} events") for kind in FAULTS) if known else 0
            swaps = _total(subset, "swap events") if any("swaps_exact" in row.values for row in subset.rows) else 0
            rows.append(
                (
                    label,
                    size,
                    *(_share(_total(subset, f"{kind} found"), _total(subset, f"{kind} events")) for kind in FAULTS),
                    _share(_total(subset, "repaired"), events),
                    _share(right, right + _total(subset, "wrong")),
                    _share(right, right + _total(subset, "wrong_anew")),
                    _share(_total(subset, "swaps_exact"), swaps),
                    number(_pooled(subset)),
                    number(_ratio(subset, truth)),
                )
            )
    return [
        Table(
            title="Events found and repaired, doubted samples that are faulty, RMSE of the faulty samples, mm",
            header=header,
            rows=tuple(rows),
        ),
        _untouched(results),
    ]


def _untouched(results: Results) -> Table:
    """Return the table of doubted samples per 100,000 in takes as they are, and of those that the defaults replace."""
    untouched = results.where(size=0)
    columns = [(label, label, "wrong") for label in results.labels if untouched.where(label=label).rows]
    columns += [(f"{label}, replaced", label, "replaced_wrong") for label, _, _ in columns if label.endswith("all")]
    rates = [
        [_rate(untouched.where(take=take, label=label), measure) for take in results.takes]
        for _, label, measure in columns
    ]
    medians = [number(float(np.median([v for v in values if v is not None]))) if values else "-" for values in rates]
    rows = [(take, *map(number, row)) for take, row in zip(results.takes, zip(*rates, strict=True), strict=True)]
    return Table(
        title="Doubted samples per 100,000 in takes as they are",
        header=("take", *(header for header, _, _ in columns)),
        rows=(*rows, ("median", *medians)),
    )


def _rate(results: Results, measure: str) -> float | None:
    """Return the samples of a measure per 100,000; None without samples."""
    samples = _total(results, "samples")
    return 1e5 * _total(results, measure) / samples if samples else None


def _pooled(results: Results) -> float | None:
    """Return the RMSE over the faulty samples of all rows; None if none was measured."""
    known = [(row.values["rmse"], row.values["faulty"]) for row in results.rows if "rmse" in row.values]
    count = sum(n for _, n in known)
    return float(np.sqrt(sum(n * rmse**2 for rmse, n in known) / count)) if count else None


def _ratio(subset: Results, truth: Results) -> float | None:
    """Return the ratio of the pooled RMSE to that of a fill that is given the faults."""
    ours, best = _pooled(subset), _pooled(truth)
    return ours / best if ours is not None and best else None


def figures(results: Results) -> list[Figure]:
    """Return the figure of the share of events found over their size, with a panel for each kind."""
    panels = []
    for kind in FAULTS:
        curves = []
        for label in results.labels:
            if label.split()[-1] not in ("all", "tdd", "hampel"):
                continue
            points = [
                (float(size), _total(subset, f"{kind} found") / max(_total(subset, f"{kind} events"), 1.0))
                for (size,) in results.cells("size")
                if size != "0"
                for subset in [results.where(label=label, size=size)]
                if subset.rows
            ]
            curves.append(Curve(label=label, x=[x for x, _ in points], y=[y for _, y in points]))
        panels.append(Panel(title=kind, x_label="size", y_label="share found", curves=tuple(curves), log_x=True))
    return [Figure(name="trust_found", title="Events found by size", panels=tuple(panels))]


EXPERIMENT = Experiment(
    reference="faults of known place, kind and size, mocapclean.simulate.inject",
    measures=MEASURES,
    trials=trials,
    tables=tables,
    figures=figures,
    quick_frames=QUICK_FRAMES,
)
