"""Fill rotations and translations of joints: the default method in the tangent space of each joint's rotations.

A rotation q of a joint is the vector v = log(p⁻¹ q), in degrees, about a reference p near it. A gap of the joint is
then a gap of three numbers, as that of a marker. The default method fills it from the rotations of the other joints and
from the joint's own path (``mocapclean.solvers.kriging``). With s a plain path over the gap and k the answer of the
method, the filled rotation is

    q = s exp(w log(s⁻¹ k))      w = σₛ² / (σₛ² + σₖ²)      σ² = w σₖ²

The plain path lies between the straight turn over the gap (slerp) and the cubic h that meets the velocities of both
sides: s₀ exp(c log(s₀⁻¹ h)) with the c that errs least on stretches of this length in this very take. σₛ is its error
there; it grows from the ends of a gap to its middle as a parabola.
σₖ is the method's own error bar, times a factor from windows: copies of the gaps, hidden where the joints are known,
are filled as the gaps are. So a joint that turns plainly, an answer that is not sure, and the ends of a gap stay near
the plain path.

Sources: K. Shoemake, 1985, doi:10.1145/325165.325242 (slerp); J. Solà and others, 2018, A micro Lie theory for state
estimation in robotics, arXiv:1812.01537, eqs. 25 and 26 (log and exp).
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, column_runs, evenly_spaced, runs
from mocapclean.evaluation.self_check import Params as HidingParams
from mocapclean.evaluation.self_check import hide
from mocapclean.geometry.joint_motion import (
    JointMotion,
    angles_between,
    conjugate,
    from_vectors,
    rotation_vectors,
    straight_turns,
    times,
)
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method
from mocapclean.take import Take

_METHOD = "kriging"
_MM_PER_DEGREE = 5.0
"""Millimetres that stand for a degree, for a method whose limits are millimetres: the arc at 0.29 m, a forearm."""
_FARTHEST = 150.0
"""Degrees from its reference within which a rotation has one vector that changes smoothly; at 180 it jumps."""
_WINDOWS = 60
"""Most gaps hidden to measure the error bars. By hand; their cost is that of as many gaps."""
_LEAST_HIDDEN = 0.02
"""Share of the known samples that is hidden at least. By hand: twice that of the self-check, for takes with one gap."""
_FACTORS = (0.5, 4.0)
"""Least and largest factor of the error bars. Chosen by hand."""
_DEPENDENCE = 1.25
"""What weighed error bars are multiplied by, because both parts err alike. Chosen on half of the captures: 90 %."""
_INTERVAL_90 = 1.645
"""Standard deviations on each side of the mean that hold 90 % of a normal distribution."""
_LAG = 2
"""Frames over which the velocity beside a gap is measured. By hand: one frame has twice the noise, more are late."""
_FEWEST_STRETCHES, _STRETCHES = 20, 200
"""Stretches of a take from which σₛ is measured: with fewer than the first number it is not known. Chosen by hand."""
_FINEST = 1e-3
"""Degrees that no error is below: a tenth of what two decimals of three angles round away. Chosen by hand."""


@dataclass(frozen=True, kw_only=True)
class JointAnswer:
    """The filled motion of joints.

    rotations: (F, J, 4). translations: (F, J, 3) mm. rotation_sd: (F, J) degrees about each axis, and translation_sd:
    (F, J) mm along each, 0 where nothing was filled. filled: (F, J), the wanted samples that were filled.
    """

    rotations: Floats
    translations: Floats
    rotation_sd: Floats
    translation_sd: Floats
    filled: Bools


def fill_joints(
    motion: JointMotion, names: tuple[str, ...], wanted_rotations: Bools, wanted_translations: Bools, rate: float
) -> JointAnswer:
    """Return the motion of joints with the wanted rotations and translations (F, J) filled; ``rate`` in Hz."""
    rotations, rotation_sd = motion.rotations.copy(), np.zeros(wanted_rotations.shape)
    done = ~wanted_rotations
    for group in _groups(motion, wanted_rotations):
        charts = _Charts(motion, names, rate, group)
        answer, sd = charts.filled(wanted_rotations & group.mask)
        here = np.isfinite(sd)
        rotations[here], rotation_sd[here] = answer[here], sd[here]
        done |= here
    translations, translation_sd = _translations(motion, names, rate, wanted_translations)
    moved = np.isfinite(translation_sd) | ~wanted_translations
    return JointAnswer(
        rotations=rotations,
        translations=translations,
        rotation_sd=rotation_sd,
        translation_sd=np.where(np.isfinite(translation_sd), translation_sd, 0.0),
        filled=done & moved,
    )


@dataclass(frozen=True)
class _Group:
    """Gaps that are filled together, and the reference rotation (J, 4) of each joint's vectors.

    mask: (F, J), the samples of these gaps.
    """

    mask: Bools
    references: Floats


def _groups(motion: JointMotion, wanted: Bools) -> list[_Group]:
    """Return the gaps of all joints that stay near their mean rotation as one group, and each other gap by itself."""
    means = _means(motion)
    away = angles_between(means[None], motion.rotations)
    near = np.where(motion.rotation_known, away, 0.0).max(axis=0) <= _FARTHEST
    groups = [_Group(wanted & near, means)] if (wanted & near).any() else []
    for joint, start, stop in column_runs(wanted & ~near):
        mask = np.zeros_like(wanted)
        mask[start:stop, joint] = True
        references = means.copy()
        # The middle of the straight turn over the gap.
        references[joint] = motion.rotations[(start + stop) // 2, joint]
        groups.append(_Group(mask, references))
    return groups


def _means(motion: JointMotion) -> Floats:
    """Return the mean rotation (J, 4) of each joint: the normed sum of its known quaternions, or the first one."""
    signed = (
        motion.rotations * np.sign(np.einsum("fjk,jk->fj", motion.rotations, motion.rotations[0]) + 1e-300)[..., None]
    )
    sums = (signed * motion.rotation_known[..., None]).sum(axis=0)
    sizes = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.asarray(np.where(sizes > 0.0, sums / np.where(sizes > 0.0, sizes, 1.0), motion.rotations[0]))


class _Charts:
    """The rotations of all turning joints as vectors about references, and their fill by the method.

    joints: (n,) the turning joints. vectors: (F, n, 3) degrees. known: (F, n), where a vector is right.
    """

    def __init__(self, motion: JointMotion, names: tuple[str, ...], rate: float, group: _Group) -> None:
        self.motion, self.rate = motion, rate
        self.joints: Ints = np.flatnonzero(motion.turns)
        self.names = tuple(names[joint] for joint in self.joints)
        self.references = group.references[self.joints]
        self.rotations = motion.rotations[:, self.joints]
        self.vectors = rotation_vectors(times(conjugate(self.references)[None], self.rotations))
        near = np.linalg.norm(self.vectors, axis=2) <= _FARTHEST
        self.known = motion.rotation_known[:, self.joints] & near

    def filled(self, wanted: Bools) -> tuple[Floats, Floats]:
        """Return rotations (F, J, 4) and sd (F, J), degrees, of wanted samples; sd NaN without an answer."""
        own = wanted[:, self.joints]
        take = self._take(self.known)
        found, sd = self._solved(take, own)
        gaps = [(column, start, stop) for column, start, stop in column_runs(own)]
        factors = self._factors(take, own)
        answer, bars = self.rotations.copy(), np.full(own.shape, np.nan)
        for column, start, stop in gaps:
            span = (slice(start, stop), column)
            if np.isfinite(sd[span]).all():
                factor = factors.of(stop - start)
                answer[span], bars[span] = self._weighed(self.known, found[span], factor * sd[span], column, start)
        whole, whole_sd = self.motion.rotations.copy(), np.full(wanted.shape, np.nan)
        whole[:, self.joints], whole_sd[:, self.joints] = answer, bars
        return whole, whole_sd

    def _take(self, known: Bools) -> Take:
        """Return the vectors as a take of markers."""
        return Take(positions=self.vectors * _MM_PER_DEGREE, trusted=known, markers=self.names, rate=self.rate)

    def _solved(self, take: Take, wanted: Bools) -> tuple[Floats, Floats]:
        """Return the method's rotations (F, n, 4) and sd (F, n), degrees, NaN where it has no answer."""
        solution = run_method(_METHOD, take, SOLVERS[_METHOD].Params(), wanted=wanted)
        vectors = np.where(solution.filled[..., None], solution.positions / _MM_PER_DEGREE, self.vectors)
        rotations = times(self.references[None], from_vectors(vectors))
        assert solution.sd is not None
        return rotations, np.where(wanted & solution.filled, solution.sd / _MM_PER_DEGREE, np.nan)

    def _straight(self, known: Bools, column: int, start: int, stop: int) -> Floats:
        """Return the straight turn (n, 4) over a gap from the known frames (F, n) beside it."""
        rotations, unknown = self.rotations[:, column], ~known[:, column]
        unknown[start:stop] = True
        first, last = _widened(unknown, start, stop)
        span = slice(max(first - 1, 0), last + 1)
        return straight_turns(rotations[span], unknown[span])[start - span.start : stop - span.start]

    def _weighed(self, known: Bools, found: Floats, sd: Floats, column: int, start: int) -> tuple[Floats, Floats]:
        """Return the rotations (n, 4) of a gap between its plain path and the answer, and their sd (n,), degrees.

        known: (F, n) the frames from which the plain path comes. found, sd: (n, 4), (n,) the method's answer.
        """
        length = len(found)
        plain, middle_sd = self._plain(known, column, start, length)
        # σₛ in the middle, and 4 x (1 - x) of it at the share x of the gap
        share = np.arange(1, length + 1) / (length + 1)
        plain_variance = (middle_sd * 4.0 * share * (1.0 - share)) ** 2 + _FINEST**2
        weight = 1.0 / (1.0 + sd**2 / plain_variance)  # 1 where σₛ is not known
        away = weight[:, None] * rotation_vectors(times(conjugate(plain), found))
        return times(plain, from_vectors(away)), _DEPENDENCE * np.sqrt(weight) * sd

    def _plain(self, known: Bools, column: int, start: int, length: int) -> tuple[Floats, float]:
        """Return the plain path (n, 4) over a gap, and σₛ: the RMS angle about an axis of its error in the middle."""
        straight = self._straight(known, column, start, start + length)
        stretches = self._stretches(column, length)
        if len(stretches) < _FEWEST_STRETCHES:
            return straight, np.inf
        share, errors = self._share_of_cubic(column, stretches, length)
        sides = [*range(start - 1 - _LAG, start), *range(start + length, start + length + 1 + _LAG)]
        if sides[0] < 0 or sides[-1] >= len(known) or not known[sides, column].all():
            return straight, errors[0]
        cubic = _cubic(self.rotations[:, column], np.array([start]), length, np.arange(1, length + 1))[0]
        bent = rotation_vectors(times(conjugate(straight), cubic))
        return times(straight, from_vectors(share * bent)), errors[1]

    def _stretches(self, column: int, length: int) -> Ints:
        """Return the starts of stretches of some frames in which, and beside which, a joint is known."""
        known, beside = self.known[:, column], 1 + _LAG
        starts = np.arange(beside, len(known) - length - beside + 1)
        complete = np.concatenate([[0], np.cumsum(known)])
        whole = complete[starts + length + beside] - complete[starts - beside] == length + 2 * beside
        starts = starts[whole]
        return np.asarray(starts[evenly_spaced(len(starts), _STRETCHES)])

    def _share_of_cubic(self, column: int, starts: Ints, length: int) -> tuple[float, tuple[float, float]]:
        """Return the share c of the cubic, and the RMS errors about an axis of the straight turn and plain path.

        c is the least-squares answer to log(s⁻¹ q) = c log(s⁻¹ h) in the middle of stretches, within 0 to 1; degrees.
        """
        rotations, step = self.rotations[:, column], np.array([length // 2 + 1])
        left, right = rotations[starts - 1], rotations[starts + length]
        turn = rotation_vectors(times(conjugate(left), right))
        straight = times(left, from_vectors(step / (length + 1) * turn))
        true, bent = (
            rotation_vectors(times(conjugate(straight), path))
            for path in (rotations[starts + length // 2], _cubic(rotations, starts, length, step)[:, 0])
        )
        share = float(np.clip((true * bent).sum() / max(float((bent**2).sum()), _FINEST**2), 0.0, 1.0))
        without, with_cubic = (float(np.sqrt((each**2).mean())) for each in (true, true - share * bent))
        return share, (without, with_cubic)

    def _factors(self, take: Take, wanted: Bools) -> "_Factors":
        """Return the factors of the error bars, from copies of the gaps that are hidden where the joints are known."""
        hidden = hide(take, wanted, HidingParams(gaps=_WINDOWS, least=_LEAST_HIDDEN)) & self.known
        factors = _Factors()
        if hidden.any():
            found, sd = self._solved(self._take(self.known & ~hidden), hidden)
            for column, start, stop in column_runs(hidden):
                span = (slice(start, stop), column)
                if np.isfinite(sd[span]).all():
                    errors = rotation_vectors(times(conjugate(self.rotations[span]), found[span]))
                    factors.add(errors, sd[span])
        return factors


def _cubic(rotations: Floats, starts: Ints, length: int, steps: Ints) -> Floats:
    """Return cubic paths (n, m, 4) over gaps at these steps after the last known frame, with both velocities met.

    rotations: (F, 4). In the tangent space of the frame before the gap, with θ the turn over the gap, v and w the turns
    per frame before and after it, T the frames from side to side and u = t / T (Hermite):

        h(t) = (3 u² - 2 u³) θ + T (u - 2 u² + u³) v + T (u³ - u²) w
    """
    left, right = starts - 1, starts + length
    turn = rotation_vectors(times(conjugate(rotations[left]), rotations[right]))
    before = rotation_vectors(times(conjugate(rotations[left - _LAG]), rotations[left])) / _LAG
    after = rotation_vectors(times(conjugate(rotations[right]), rotations[right + _LAG])) / _LAG
    frames = length + 1
    u = (steps / frames)[None, :, None]
    path = (3 * u**2 - 2 * u**3) * turn[:, None]
    path = path + frames * ((u - 2 * u**2 + u**3) * before[:, None] + (u**3 - u**2) * after[:, None])
    return times(rotations[left][:, None], from_vectors(path))


class _Factors:
    """Errors over error bars of hidden windows, by the length of the window."""

    def __init__(self) -> None:
        self.lengths: list[int] = []
        self.ratios: list[Floats] = []

    def add(self, errors: Floats, sd: Floats) -> None:
        """Add the errors (n, 3) and error bars (n,) of a window, degrees."""
        self.lengths.append(len(sd))
        self.ratios.append((np.abs(errors) / np.maximum(sd, _FINEST)[:, None]).ravel())

    def of(self, length: int) -> float:
        """Return what the bars of a gap are multiplied by, so that 90 % of the errors of like windows are inside."""
        like = [ratios for n, ratios in zip(self.lengths, self.ratios, strict=True) if length <= 2 * n <= 4 * length]
        if not like:
            return 1.0
        return float(np.clip(np.quantile(np.concatenate(like), 0.9) / _INTERVAL_90, *_FACTORS))


def _widened(unknown: Bools, start: int, stop: int) -> tuple[int, int]:
    """Return the run of unknown frames that a span lies in."""
    found = runs(unknown)
    index = int(np.searchsorted(found[:, 0], start, side="right")) - 1
    return int(found[index, 0]), int(found[index, 1])


def _translations(motion: JointMotion, names: tuple[str, ...], rate: float, wanted: Bools) -> tuple[Floats, Floats]:
    """Return translations (F, J, 3), mm, with the wanted ones filled, and their sd (F, J), NaN without an answer."""
    translations, sd = motion.translations.copy(), np.full(wanted.shape, np.nan)
    if not wanted.any():
        return translations, sd
    joints = np.flatnonzero(motion.shifts)
    take = Take(
        positions=motion.translations[:, joints],
        trusted=motion.translation_known[:, joints],
        markers=tuple(names[joint] for joint in joints),
        rate=rate,
        detached=np.ones(len(joints), dtype=bool),
    )
    solution = run_method(_METHOD, take, SOLVERS[_METHOD].Params(), wanted=wanted[:, joints])
    assert solution.sd is not None
    done = wanted[:, joints] & solution.filled
    part = translations[:, joints]
    part[done] = solution.positions[done]
    translations[:, joints] = part
    bars = sd[:, joints]
    bars[done] = solution.sd[done]
    sd[:, joints] = bars
    return translations, sd
