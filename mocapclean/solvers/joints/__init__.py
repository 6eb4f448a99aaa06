"""Fill rotations and translations of joints: the default method in the tangent space of each joint's rotations.

A rotation q of a joint is the vector v = log(p⁻¹ q), in degrees, about a reference p near it. A gap of the joint is
then a gap of three numbers, as that of a marker. The default method fills it from the rotations of the other joints and
from the joint's own path (``mocapclean.solvers.kriging``). With s a plain path over the gap and k the answer of the
method, the filled rotation is

    q = s exp(w log(s⁻¹ k))      w = σₛ² / (σₛ² + σₖ²)      σ² = w σₖ²

The plain path lies between the straight turn over the gap (slerp) and the cubic h that meets the velocities of both
sides: s₀ exp(c log(s₀⁻¹ h)) with the c that errs least on stretches of this length in this very take. σₛ is its error
there; it grows from the ends of a gap to its middle as a parabola, and at an end of the take with the frames since the
last known one.
σₖ is the method's own error bar, times a factor from windows: copies of the gaps, hidden where the joints are known,
are filled as the gaps are. So a joint that turns plainly, an answer that is not sure, and the ends of a gap stay near
the plain path.

Sources: K. Shoemake, 1985, doi:10.1145/325165.325242 (slerp); J. Solà and others, 2018, A micro Lie theory for state
estimation in robotics, arXiv:1812.01537, eqs. 25 and 26 (log and exp).
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, column_runs
from mocapclean.evaluation.self_check import Params as HidingParams
from mocapclean.evaluation.self_check import hide
from mocapclean.geometry.joint_motion import (
    JointMotion,
    angles_between,
    conjugate,
    from_vectors,
    rotation_vectors,
    times,
)
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.joints.calming import calmed
from mocapclean.solvers.joints.plain_path import Plain, plain_path
from mocapclean.solvers.running import run_method
from mocapclean.take import Take

_METHOD = "kriging"

_MOTION = 1e9
"""s, ``motion`` of the method: never. In 24 classes of lost joints and limbs of four takes of ``mocapclean bench
skeletons`` the error with the motion of other joints was 1.5 % more, in the median of the classes that differ.
"""
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
_FEW = 2.0
"""Share that a window's variance adds to that of an error bar, over the number of windows. Chosen on the takes at even
places, at 24 to 30 Hz, where gaps of 60 frames have one to four windows."""
_DEPENDENCE = 1.25
"""What weighed error bars are multiplied by, because both parts err alike. Chosen on half of the captures: 90 %."""
_OPEN = 2.0
"""What the method's error bar is multiplied by at an end of the take, where windows with two sides do not measure it.
Chosen on half of the captures from 1, 2 and 4: the errors in all and the bars that hold."""
_INTERVAL_90 = 1.645
"""Standard deviations on each side of the mean that hold 90 % of a normal distribution."""
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
        # The middle of the plain path over the gap.
        plain = plain_path(motion.rotations[:, joint], motion.rotation_known[:, joint], start, stop)
        references[joint] = plain.path[(stop - start) // 2]
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

    joints: (n,) the turning joints. vectors: (F, n, 3) degrees. right: (F, n), where a rotation is known.
    known: (F, n), where its vector is also far from a half turn, so that the method may use it.
    """

    def __init__(self, motion: JointMotion, names: tuple[str, ...], rate: float, group: _Group) -> None:
        self.motion, self.rate = motion, rate
        self.joints: Ints = np.flatnonzero(motion.turns)
        self.names = tuple(names[joint] for joint in self.joints)
        self.references = group.references[self.joints]
        self.rotations = motion.rotations[:, self.joints]
        self.vectors = rotation_vectors(times(conjugate(self.references)[None], self.rotations))
        near = np.linalg.norm(self.vectors, axis=2) <= _FARTHEST
        self.right = motion.rotation_known[:, self.joints]
        self.known = self.right & near

    def filled(self, wanted: Bools) -> tuple[Floats, Floats]:
        """Return rotations (F, J, 4) and sd (F, J), degrees, of wanted samples; sd NaN without an answer."""
        own = wanted[:, self.joints]
        take = self._take(self.known)
        found, sd = self._solved(take, own)
        factors = self._factors(take, own)
        answer, bars = self.rotations.copy(), np.full(own.shape, np.nan)
        for column, start, stop in column_runs(own):
            span, beside = (slice(start, stop), column), (slice(max(start - 1, 0), stop + 1), column)
            plain = plain_path(self.rotations[:, column], self.right[:, column], start, stop)
            if (self.right & ~self.known)[beside].any() and np.isfinite(plain.sd).all():
                # The sides are too far apart for one reference, and the method does not see them.
                answer[span], bars[span] = plain.path, np.hypot(plain.sd, _FINEST)
            elif np.isfinite(sd[span]).all():
                widened = _OPEN if start == 0 or stop == len(own) else 1.0
                factor = widened * factors.of(stop - start)
                path, bar = self._weighed(found[span], factor * sd[span], plain)
                own_path, own_known = self.rotations[:, column], self.right[:, column]
                answer[span] = calmed(own_path, own_known, start, path, bar, plain.path)
                bars[span] = factors.widening(stop - start) * bar
        whole, whole_sd = self.motion.rotations.copy(), np.full(wanted.shape, np.nan)
        whole[:, self.joints], whole_sd[:, self.joints] = answer, bars
        return whole, whole_sd

    def _take(self, known: Bools) -> Take:
        """Return the vectors as a take of markers."""
        return Take(positions=self.vectors * _MM_PER_DEGREE, trusted=known, markers=self.names, rate=self.rate)

    def _solved(self, take: Take, wanted: Bools) -> tuple[Floats, Floats]:
        """Return the method's rotations (F, n, 4) and sd (F, n), degrees, NaN where it has no answer."""
        solution = run_method(_METHOD, take, SOLVERS[_METHOD].Params(motion=_MOTION), wanted=wanted)
        vectors = np.where(solution.filled[..., None], solution.positions / _MM_PER_DEGREE, self.vectors)
        rotations = times(self.references[None], from_vectors(vectors))
        assert solution.sd is not None
        return rotations, np.where(wanted & solution.filled, solution.sd / _MM_PER_DEGREE, np.nan)

    def _weighed(self, found: Floats, sd: Floats, plain: Plain) -> tuple[Floats, Floats]:
        """Return the rotations (n, 4) of a gap between its plain path and the answer, and their sd (n,), degrees.

        found, sd: (n, 4), (n,) the method's answer.
        """
        weight = 1.0 / (1.0 + sd**2 / (plain.sd**2 + _FINEST**2))  # 1 where σₛ is not known
        away = weight[:, None] * rotation_vectors(times(conjugate(plain.path), found))
        return times(plain.path, from_vectors(away)), _DEPENDENCE * np.sqrt(weight) * sd

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
        like = self._like(length)
        if not like:
            return 1.0
        return float(np.clip(np.quantile(np.concatenate(like), 0.9) / _INTERVAL_90, *_FACTORS))

    def widening(self, length: int) -> float:
        """Return what the bars of a gap are multiplied by, because few windows do not show their factor well."""
        return float(np.sqrt(1.0 + _FEW / max(len(self._like(length)), 1)))

    def _like(self, length: int) -> list[Floats]:
        """Return the ratios of the windows of about the length of a gap."""
        return [ratios for n, ratios in zip(self.lengths, self.ratios, strict=True) if length <= 2 * n <= 4 * length]


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
    solution = run_method(_METHOD, take, SOLVERS[_METHOD].Params(motion=_MOTION), wanted=wanted[:, joints])
    assert solution.sd is not None
    done = wanted[:, joints] & solution.filled
    part = translations[:, joints]
    part[done] = solution.positions[done]
    translations[:, joints] = part
    bars = sd[:, joints]
    bars[done] = solution.sd[done]
    sd[:, joints] = bars
    return translations, sd
