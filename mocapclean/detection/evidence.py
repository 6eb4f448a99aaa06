"""What the rules look at: computed once for each take, when a rule first asks.

Suspicions protect the evidence from the very faults that it is to show: exchanged names are put back, markers that hold
still are passed over, steps are taken out and strays are bridged, before the markers around a sample say where it
should be. A suspicion distrusts nothing; that is for the rules.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, column_runs
from mocapclean.detection import paths
from mocapclean.detection.exchanges import Exchange, exchange, exchanges
from mocapclean.detection.prediction import Prediction, complete, predict
from mocapclean.detection.steps import BETWEEN, Step
from mocapclean.geometry.distances import Rigidity, rigidity
from mocapclean.numerics.robust import nan_median, nan_quantiles
from mocapclean.take import Take

_FARTHEST = 1e8
_ROUNDS, _SETTLED, _RUINED = 5, 5e-4, 0.9
_CLOSEST = 5
_RIVAL, _EVEN, _AGREES = 0.5, 0.7, 0.3
_CONFIRMED, _SLACK = 0.2, 3.0
_AGREED, _KEPT = 0.5, 10.0
_RIGID, _RIGID_SECONDS, _OFTEN = 0.5, 0.5, 0.9
_BENT, _BENT_SECONDS = 0.5, 2.0
_STILL = 0.005
_SHORTEST_HOLD, _LEAST_HOLD = 5, 5.0
LEAST_STEP, LEAST_SCORE, _SURE, _SURER, _SURELY = 15.0, 10.0, 0.8, 0.6, 2.0
_SAME_STEP = 0.01
_SNAP, _SNAP_SLACK = 10, 1
_STEP_SECONDS, _END_SECONDS = 1.25, 0.5
SLIDE_SECONDS = 0.5


@dataclass(frozen=True, kw_only=True)
class Hold:
    """A marker that stays put in frames start to stop while the markers around it say that it moves ``moved`` mm.

    It leaps at the end, or nothing follows; one that hardly ever moves is a thing, not a fault.
    """

    marker: int
    start: int
    stop: int
    moved: float


@dataclass(frozen=True, kw_only=True)
class Study:
    """Everything that the markers around a sample say of it; arrays are (F, M), lengths millimetres.

    holds, steps: markers that hold still, and that sit elsewhere for good. residual: (F, M, 3), the sample less what is
    expected of it, in its segment, holds (NaN) and steps taken out. threshold: the innovation that makes a break.
    deviation: how far a sample lies off the path of its marker, 0 on it. bursts: in a burst of noise. known: (M,),
    whether a marker has others around it.
    """

    holds: tuple[Hold, ...]
    steps: tuple[Step, ...]
    residual: Floats
    threshold: Floats
    deviation: Floats
    bursts: Bools
    known: Bools

    def excursion(self, marker: int, start: int, stop: int) -> str:
        """How far a marker is off its path in these frames, and how many times what its noise and motion explain."""
        away = self.deviation[start:stop, marker]
        times = float((away / self.threshold[start:stop, marker]).max())
        return f"{away.max():.0f} mm ({times:.1f} times what noise and motion explain)"


@dataclass(frozen=True)
class Evidence:
    """A take and, when a rule asks, what it says of itself."""

    take: Take

    @cached_property
    def near(self) -> Bools:
        """The trusted samples (F, M) within 100 km of their median: what is farther is no measurement in any unit."""
        trusted = self.take.trusted
        if not trusted.any():
            return trusted
        middle = np.median(self.take.positions[trusted], axis=0)
        return np.asarray(trusted & (np.abs(self.take.positions - middle) <= _FARTHEST).all(axis=2))

    @cached_property
    def rigid(self) -> Rigidity:
        """How rigidly the markers are tied to each other."""
        return rigidity(self.take.positions, self.near)

    @cached_property
    def exchanges(self) -> tuple[Exchange, ...]:
        """Pairs of markers that bear each other's name for a time."""
        return exchanges(np.where(self.near[..., None], self.take.positions, np.nan), self.rigid)

    @cached_property
    def study(self) -> Study:
        """What the markers around each sample say of it."""
        trusted = self.near
        positions = exchange(self.take.positions, self.exchanges)
        rigid = rigidity(positions, trusted) if self.exchanges else self.rigid
        bones = _Bones(np.where(trusted[..., None], positions, np.nan), rigid, self.take.rate)
        usable, slide = trusted, round(SLIDE_SECONDS * self.take.rate)
        steps: tuple[Step, ...] = ()
        before, sliding = usable, np.zeros_like(usable)
        around = min(slide, int(BETWEEN * len(usable)))
        for round_ in range(_ROUNDS):
            filled = complete(positions, usable, rigid)
            guess = predict(filled, usable, rigid, slide=slide if round_ < _ROUNDS - 1 else None)
            holds = _holds(positions, trusted, guess)
            measured = trusted & ~_held(holds, trusted)
            look = _Look(positions, filled, guess, measured, usable, rigid, bones, steps, self.take.rate)
            clear = _clear(guess.steps, look)
            able = [step for step in clear if all(step.marker != old.marker for old in steps) and look.explains(step)]
            for step in able:
                look.spare(step)
            earlier, before, usable = before, usable, look.measured & ~look.astray & ~look.bursts & ~sliding
            fresh = np.asarray((before & ~usable).any(axis=0) & (round_ == 0))
            found = _standing_out(able, clear, steps, fresh, look)
            changed = min(np.count_nonzero(usable ^ one) for one in (before, earlier)[: max(1, round_)])
            settled = not found and changed <= _SETTLED * usable.size
            if settled or np.count_nonzero(usable) < _RUINED * np.count_nonzero(trusted):
                break
            positions = positions.copy()
            for step in found:
                positions[step.start :, step.marker] -= guess.rotation[step.start :, step.marker] @ step.offset
                if not step.sudden:
                    sliding[max(0, step.start - around) : step.start + around, step.marker] = True
            steps, usable = (*steps, *found), usable & ~sliding
        return Study(
            holds=holds,
            steps=steps,
            residual=look.residual,
            threshold=look.threshold,
            deviation=look.deviation,
            bursts=look.bursts,
            known=guess.known,
        )


class _Look:
    """The paths of all markers in one round: what is measured (F, M) of positions, and which samples stray.

    Those before or after all of its path are not astray: a step may yet explain them.
    """

    def __init__(
        self,
        positions: Floats,
        filled: Floats,
        guess: Prediction,
        measured: Bools,
        usable: Bools,
        rigid: Rigidity,
        bones: "_Bones",
        steps: tuple[Step, ...],
        rate: float,
    ) -> None:
        self.filled, self.turns, self.rigid, self.bones = filled, guess.rotation, rigid, bones
        self.measured, self.usable = measured, usable
        self.tolls = _STEP_SECONDS * rate, _END_SECONDS * rate
        self.around = round(SLIDE_SECONDS * rate / 2)
        self.positions = np.where(measured[..., None], positions, np.nan)
        self.residual = ((self.positions - guess.expected)[..., None, :] @ guess.rotation)[..., 0, :]
        innovation = paths.innovations(self.positions, self.residual)
        self.threshold = paths.thresholds(innovation, usable, guess.expected)
        self.breaks = innovation > self.threshold
        for step in steps:
            self._forgive(self.breaks[:, step.marker], step)
        self.deviation, self.costs = np.zeros(measured.shape), np.zeros(measured.shape[1])
        self.astray = np.zeros_like(measured)
        for marker in np.flatnonzero(self.breaks.any(axis=0)).tolist():
            path = self.positions[:, marker], self.residual[:, marker], self.breaks[:, marker]
            self.deviation[:, marker], within, self.costs[marker] = self._path(marker, *path)
            self.astray[within, marker] = self.deviation[within, marker] > 0
        self.bursts = paths.bursts(innovation, usable, guess.expected) & measured

    def seen(self, step: Step) -> Step:
        """A step as its path and its bones show it.

        It is made at the frame near it at which the residual makes most of it at once, if any makes half of it; it is
        sudden where that is a break. Distances have a say where most of the closest partners keep theirs to 10 mm.
        """
        size, low = float(np.linalg.norm(step.offset)), max(1, step.start - _SNAP)
        path = self.residual[low - 1 : step.start + _SNAP + 1, step.marker]
        rises = np.nan_to_num(np.diff(path, axis=0) @ step.offset / size)
        if rises.max(initial=0.0) > size / 2:
            start = low + int(np.argmax(rises))
            step = replace(step, start=start, sudden=bool(self.breaks[start, step.marker]))
        kept = np.median(self.rigid.spread[step.marker, self.rigid.partners(step.marker)[0][:_CLOSEST]]) <= _KEPT
        bends = len(self.bones.bent(step.marker, step.start))
        return replace(step, bends=bends, agreed=bool(kept) and self.agrees(step) >= _AGREED)

    def explains(self, step: Step) -> bool:
        """Whether the marker's path costs no more with a step taken out than with it."""
        return self._without(step)[2] <= float(self.costs[step.marker])

    def spare(self, step: Step) -> None:
        """Take for astray only what is so with a step taken out, if it is sure and the path is cheaper and as long."""
        off, within, cost = self._without(step)
        lost = (off > 0) & (self.deviation[:, step.marker] == 0)
        lost[within] = False
        if step.score >= _SURELY * LEAST_SCORE and cost < self.costs[step.marker] and not lost.any():
            self.astray[:, step.marker] = False
            self.astray[within, step.marker] = off[within] > 0

    def remains(self, other: Step, without: Step) -> float:
        """The score of a marker's step at about the same time after another one is taken out."""
        filled = self.filled.copy()
        filled[without.start :, without.marker] -= self.turns[without.start :, without.marker] @ without.offset
        only = np.arange(filled.shape[1]) == other.marker
        left = predict(filled, self.usable, self.rigid, slide=2 * self.around, only=only).steps
        return max((step.score for step in left if self.near(step, other)), default=0.0)

    def agrees(self, step: Step, aside: int | None = None) -> float:
        """How much of the change in the distances to its partners a step explains, one marker aside; at most 1.

        A partner counts the less, the less it keeps its distance.
        """
        partners = self.rigid.partners(step.marker)[0]
        partners = partners[partners != aside][:_CLOSEST]
        share = 1.0 / (self.rigid.spread[step.marker, partners] + _SLACK)
        away = self.positions[:, partners] - self.positions[:, [step.marker]]
        undone = away[step.start :] + (self.turns[step.start :, step.marker] @ step.offset)[:, None]
        before, after, should = (
            nan_median(np.linalg.norm(way, axis=2)) for way in (away[: step.start], away[step.start :], undone)
        )
        return float(1.0 - share @ np.abs(should - before) / max(share @ np.abs(after - should), 1e-9))

    def near(self, one: Step, other: Step) -> bool:
        """Whether two steps are made at about the same time."""
        return abs(one.start - other.start) <= _SNAP + _SAME_STEP * len(self.measured)

    def _without(self, step: Step) -> tuple[Floats, slice, float]:
        """The path of a step's marker with the step taken out."""
        residual, breaks = self.residual[:, step.marker].copy(), self.breaks[:, step.marker].copy()
        residual[step.start :] -= step.offset
        self._forgive(breaks, step)
        return self._path(step.marker, self.positions[:, step.marker], residual, breaks)

    def _path(self, marker: int, positions: Floats, residual: Floats, breaks: Bools) -> tuple[Floats, slice, float]:
        rest = self.threshold[:, marker], self.usable[:, marker]
        return paths.deviations(positions, residual, breaks, *rest, *self.tolls)

    def _forgive(self, breaks: Bools, step: Step) -> None:
        around = _SNAP_SLACK if step.sudden else self.around
        breaks[max(0, step.start - around) : step.start + around + 1] = False


class _Bones:
    """Which partners keep their distance, and when they cease to: positions (F, M, 3), NaN where not trusted.

    Those do that are at the same distance half a second later in nine of ten cases, the frames about a step aside.
    """

    def __init__(self, positions: Floats, rigid: Rigidity, rate: float) -> None:
        self.positions, self.rigid = positions, rigid
        self.lag, self.around, self.window = (
            max(1, round(seconds * rate)) for seconds in (_RIGID_SECONDS, SLIDE_SECONDS / 2, _BENT_SECONDS)
        )
        self.lag, self.around = min(self.lag, len(positions) // 2), self.around + _SNAP
        self.ends = dict[tuple[int, int], Ints]()

    def of(self, marker: int, frame: int) -> Ints:
        """The other ends of a marker's bones, whatever happens to them about a frame."""
        if (marker, frame) not in self.ends:
            partners = self.rigid.partners(marker)[0]
            apart = self._apart(marker, partners)
            changes = np.abs(apart[self.lag :] - apart[: -self.lag])
            changes[max(0, frame - self.around - self.lag) : frame + self.around] = np.nan
            often = nan_quantiles(changes, (_OFTEN,))[0]
            self.ends[marker, frame] = partners[often <= _RIGID]
        return self.ends[marker, frame]

    def bent(self, marker: int, frame: int) -> Ints:
        """The other ends of the bones of a marker whose median length changes about a frame.

        What lies within the time of a slide of it is left out, or the nearer half of what there is.
        """
        ends = self.of(marker, frame)
        apart = self._apart(marker, ends)
        first, last = frame - min(self.around, frame // 2), frame + min(self.around, (len(apart) - frame) // 2)
        before, after = apart[max(0, first - self.window) : first], apart[last:][: self.window]
        return ends[np.abs(nan_median(after) - nan_median(before)) > _BENT] if len(before) and len(after) else ends[:0]

    def allow(self, step: Step, stepped: list[int], stepping: list[int]) -> bool:
        """Whether a step bends a bone of its marker, if it has any, to markers that have not stepped at that time.

        Where it bends but one, to a marker that may step as well, the others of that marker must be as they were.
        """
        bent = [end for end in self.bent(step.marker, step.start).tolist() if end not in stepped]
        alone = len(bent) == 1 and (bent[0] not in stepping or len(self.bent(bent[0], step.start)) <= 1)
        return not len(self.of(step.marker, step.start)) or len(bent) > 1 or alone

    def _apart(self, marker: int, ends: Ints) -> Floats:
        return np.asarray(np.linalg.norm(self.positions[:, ends] - self.positions[:, [marker]], axis=2))


def _holds(positions: Floats, trusted: Bools, guess: Prediction) -> tuple[Hold, ...]:
    still = np.zeros_like(trusted)
    still[1:] = (np.abs(np.diff(positions, axis=0)) <= _STILL).all(axis=2) & trusted[1:] & trusted[:-1]
    found = []
    for marker, start, stop in column_runs(still & guess.known):
        moving = 2 * (stop - start) < np.count_nonzero(trusted[:, marker])
        if stop - start >= _SHORTEST_HOLD and moving and _leaps(positions[:, marker], trusted[:, marker], stop):
            way = guess.expected[start - 1 : stop, marker]
            moved = float(np.linalg.norm(way - way[0], axis=1).max())
            if moved >= _LEAST_HOLD:
                found.append(Hold(marker=marker, start=start, stop=stop, moved=moved))
    return tuple(found)


def _leaps(path: Floats, trusted: Bools, frame: int) -> bool:
    """Whether a path (F, 3) is let go at a frame: it is not seen, or far from before and not on its way as fast."""
    if frame == len(path) or not trusted[frame]:
        return True
    leap = float(np.linalg.norm(path[frame] - path[frame - 1]))
    later = frame + 1 < len(path) and trusted[frame + 1]
    onward = float(np.linalg.norm(path[frame + 1] - path[frame])) if later else 0.0
    return leap >= max(_LEAST_HOLD, 2.0 * onward)


def _held(holds: tuple[Hold, ...], trusted: Bools) -> Bools:
    mask = np.zeros_like(trusted)
    for hold in holds:
        mask[hold.start : hold.stop, hold.marker] = True
    return mask


def _clear(steps: tuple[Step, ...], look: _Look) -> list[Step]:
    """The steps, surest first, that are large and sure enough."""
    large = (step for step in steps if np.linalg.norm(step.offset) >= LEAST_STEP)
    seen = (look.seen(step) for step in large if step.score >= _SURER * LEAST_SCORE)
    return sorted((step for step in seen if step.score >= surely(step)), key=lambda step: -step.score)


def _standing_out(
    able: list[Step], clear: list[Step], known: tuple[Step, ...], fresh: Bools, look: _Look
) -> list[Step]:
    """Which of the steps that are able to stand out, best first; clear: all that are sure enough.

    Of partners that step at the same time, where their bones allow it, the surest goes first, unless it is an echo;
    the echoes of it are gone in the next round.
    """
    chosen: list[Step] = []
    for step in able:
        if _waits(step, fresh, look) or not _borne_out(step, look) or not _allowed(step, clear, known, look):
            continue
        tied = [other for other in clear if _tied(step, other, look) and _allowed(other, clear, known, look)]
        if any(other.marker == old.marker for other in tied for old in chosen):
            continue
        if not any(_echoes(step, other, look) for other in tied):
            chosen.append(step)
    return chosen


def _waits(step: Step, fresh: Bools, look: _Look) -> bool:
    """Whether fresh (M,) strays of its marker, or of those that measure it, may make up a step.

    They do not make up two bones to others that change.
    """
    firm = ~fresh[look.bones.bent(step.marker, step.start)]
    near = [step.marker, *look.rigid.partners(step.marker)[0][:_CLOSEST]]
    return bool(firm.sum() < 2 and fresh[near].any())


def _borne_out(step: Step, look: _Look) -> bool:
    """Whether a step is seen in the path, in two bones or in the distances to partners, or is sure enough without."""
    sure = step.sudden or step.score >= _SURELY * LEAST_SCORE
    return sure or step.bends > 1 or look.agrees(step) >= _CONFIRMED


def _allowed(step: Step, clear: list[Step], known: tuple[Step, ...], look: _Look) -> bool:
    """Whether the bones allow a step, with what has stepped or may step at the same time."""
    stepped, stepping = ([one.marker for one in of if look.near(one, step)] for of in (known, clear))
    return look.bones.allow(step, stepped, stepping)


def surely(step: Step, least: float = LEAST_SCORE) -> float:
    """The least score of a step, less where something else than the regression shows it as well."""
    return least * (_SURER if step.bends or step.sudden else _SURE if step.agreed else 1.0)


def _echoes(step: Step, other: Step, look: _Look) -> bool:
    """Whether a step is but an echo of one with a smaller score.

    It goes with it and not the other way round; or each goes with the other, their scores are about even, and the other
    explains the changed distances to their partners better.
    """
    if other.score < _RIVAL * step.score:
        return False
    goes, stays = look.remains(step, other) < surely(step), look.remains(other, step) >= surely(other)
    even = goes and not stays and other.score >= _EVEN * step.score
    agree = look.agrees(step, other.marker), look.agrees(other, step.marker)
    return (goes and stays) or (even and agree[1] > max(agree[0], _AGREES))


def _tied(one: Step, other: Step, look: _Look) -> bool:
    """Whether two steps are of partners and at about the same time."""
    partners = look.rigid.partners
    tied = other.marker in partners(one.marker)[0] or one.marker in partners(other.marker)[0]
    return tied and one.marker != other.marker and look.near(one, other)
