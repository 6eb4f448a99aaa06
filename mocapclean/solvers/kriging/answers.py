"""Answer the segments of gaps together: those of the same layout are predicted in batches."""

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Floats, Ints
from mocapclean.solvers.kriging.bridging import PlanBridges, patterns_of
from mocapclean.solvers.kriging.gap_segment import Answer, Evidence, GapSegment
from mocapclean.solvers.kriging.own_path import predict_from_own_path
from mocapclean.solvers.kriging.prediction import Neighbourhoods, predict_all
from mocapclean.solvers.kriging.predictors import Predictor, applicable
from mocapclean.solvers.kriging.regression_kriging import KrigingResult
from mocapclean.solvers.kriging.sampling_plan import SamplingPlan
from mocapclean.solvers.kriging.segment_batch import batch_frames, batch_of
from mocapclean.solvers.kriging.take_state import TakeState

HELD_OUT_MARGIN = 3  # frames around a window that are held out of the regression with it; chosen by hand
BATCH_ROWS = 6000  # frames of all segments of a batch together; chosen by hand for speed, so that caches hold them
DISPLACEMENT = 0.025
"""s before and after a frame between which the displacements of neighbours are taken.

Chosen among 1/40, 1/20 and 1/10 s on the first half of the takes of ``mocapclean bench occlusion``.
"""
NEIGHBOUR_STEP = 4  # a batch has segments whose numbers of neighbours differ by less; chosen by hand for speed


class _Planned(NamedTuple):
    """A segment with its frames, its bridges over time, and the predictors that its neighbours allow."""

    segment: GapSegment
    plan: SamplingPlan
    bridges: PlanBridges
    predictors: list[Predictor]

    @property
    def layout(self) -> tuple[object, ...]:
        """The layout: what is equal in all segments of a batch."""
        padded = -(-len(self.segment.neighbours) // NEIGHBOUR_STEP)
        sides = len(self.plan.adjacent), tuple(self.plan.adjacent[:1].tolist())
        return tuple(self.predictors), padded, len(self.plan.inside), *sides, len(self.plan.windows) > 0


def answers(segments: Sequence[GapSegment]) -> list[Answer | None]:
    """Return the answer of each segment: positions (L, 3) and SD (L,); None without evidence or enough known samples.

    The segments are those of one take in one state.
    """
    usable = [segment for segment in segments if segment.can_be_filled]
    evidence = dict(zip(map(id, usable), _evidence(usable, resembling=False), strict=True))
    compared = [segment for segment in usable if segment.compares_alike(evidence[id(segment)])]
    alike = dict(zip(map(id, compared), _evidence(compared, resembling=True), strict=True))
    return [
        segment.answer(evidence[id(segment)], alike.get(id(segment))) if id(segment) in evidence else None
        for segment in segments
    ]


def _evidence(segments: Sequence[GapSegment], *, resembling: bool) -> list[Evidence]:
    """Return the results of all predictors for each segment; resembling: only on windows that resemble the gap."""
    planned = _planned(segments, resembling)
    following: list[list[KrigingResult]] = [[] for _ in segments]
    for members in _batches(planned):
        for k, results in zip(members, _predicted([planned[k] for k in members]), strict=True):
            following[k] = results
    return [Evidence(each.plan, results, _own_path(each)) for each, results in zip(planned, following, strict=True)]


def _planned(segments: Sequence[GapSegment], resembling: bool) -> list[_Planned]:
    """Return the segments with their plans."""
    if not segments:
        return []
    state, plans = segments[0].state, [segment.plan(resembling=resembling) for segment in segments]
    # The kriging weights over time of all plans are computed together.
    state.bridge_weights.prepare(chain.from_iterable(map(patterns_of, plans)))
    whole = [plan for segment, plan in zip(segments, plans, strict=True) if segment.whole]
    state.own_path.prepare(whole)
    return [
        _Planned(
            segment,
            plan,
            PlanBridges(plan, state.bridge_weights),
            applicable(
                len(segment.neighbours),
                bool(segment.hinge_ends),
                is_long=len(plan.gap) >= state.params.motion * state.rate,
            ),
        )
        for segment, plan in zip(segments, plans, strict=True)
    ]


def _batches(planned: list[_Planned]) -> list[list[int]]:
    """Return the indices of the segments of each batch: of one layout, of similar length, and not too many."""
    batches: dict[tuple[object, ...], list[list[int]]] = {}
    for k in sorted(range(len(planned)), key=lambda k: len(planned[k].plan.gap)):
        if not planned[k].predictors:
            continue
        of_layout = batches.setdefault(planned[k].layout, [[]])
        if len(of_layout[-1]) * len(planned[k].plan.frames) >= BATCH_ROWS:
            of_layout.append([])
        of_layout[-1].append(k)
    return [members for of_layout in batches.values() for members in of_layout if members]


def _predicted(planned: list[_Planned]) -> list[list[KrigingResult]]:
    """Return the results of the predictors for each segment of a batch; those without a defined frame are left out."""
    segments, plans = [each.segment for each in planned], [each.plan for each in planned]
    state, predictors = segments[0].state, planned[0].predictors
    counts = np.array([len(segment.neighbours) for segment in segments])
    neighbours = np.zeros((len(segments), counts.max()), dtype=np.intp)
    for row, segment in zip(neighbours, segments, strict=True):
        row[: len(segment.neighbours)] = segment.neighbours
    markers, frames = np.array([segment.marker for segment in segments]), batch_frames(plans)
    target = state.positions[frames, markers[:, None]]
    batch = batch_of(plans, [each.bridges for each in planned], target, HELD_OUT_MARGIN)
    near = Neighbourhoods(
        markers=markers,
        neighbours=neighbours,
        in_use=np.arange(counts.max()) < counts[:, None],
        hinge_ends=np.array([segment.hinge_ends or (0, 0) for segment in segments]),
        positions=state.positions[frames[..., None], neighbours[:, None]],
        displacements=_displacements(state, frames, neighbours) if any(p.moving for p in predictors) else None,
        distances=state.distances,
    )
    results = predict_all(predictors, near, batch, state.params.noise**2)
    return [[_of_segment(result, k, plan) for result, defined in results if defined[k]] for k, plan in enumerate(plans)]


def _displacements(state: TakeState, frames: Ints, neighbours: Ints) -> Floats:
    """Return the displacements (G, N, q, 3) of neighbours (G, q) around frames (G, N), mm.

    At the ends of the take they are shorter.
    """
    reach, own = max(1, round(DISPLACEMENT * state.rate)), frames < state.n_own
    first, last = np.where(own, 0, state.n_own), np.where(own, state.n_own, len(state.positions)) - 1
    before, after = np.maximum(frames - reach, first), np.minimum(frames + reach, last)
    ends = [state.positions[at[..., None], neighbours[:, None]] for at in (before, after)]
    return np.asarray(ends[1] - ends[0])


def _of_segment(results: KrigingResult, k: int, plan: SamplingPlan) -> KrigingResult:
    """Return the result of one segment of a batch, without the rows that are not in use."""
    return KrigingResult(
        positions=results.positions[k, : len(plan.gap)],
        window_errors=results.window_errors[k, : len(plan.windows)],
        gap_variance=results.gap_variance[k, : len(plan.gap)],
        window_variance=results.window_variance[k],
    )


def _own_path(planned: _Planned) -> list[KrigingResult]:
    """Return the results from the marker's own path; none for a part of a gap."""
    segment, state = planned.segment, planned.segment.state
    if not segment.whole:
        return []
    target = state.positions[planned.plan.frames, segment.marker]
    return predict_from_own_path(target, planned.plan, state.own_path, state.params.noise**2)
