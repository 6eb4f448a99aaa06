"""Training of a dictionary of a body's parts on clean takes.

For each part the windows of L frames, in the frame that moves with the body, are signals y of RMS norm 1:

1. K-SVD: min ‖y − wᵀD‖² subject to ‖w‖₀ ≤ t, D of unit norm (M. Aharon et al., 2006).
2. Missing-aware passes (Z. Wang et al., 2016, eq. 2): some markers of each window are hidden. The codes come from the
   other entries, the atoms from all, with weight κ for hidden entries. Codes of t atoms as in the first step replace
   the paper's ℓ1 codes and their parameter.
3. Atoms get the mean length and sign of their use, because local coding depends on the distances of atoms.

The numbers are those of ``training_parameters``.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.dictionaries.body_parts import PARTS, BodyParts, distinct_bare_names
from mocapclean.dictionaries.dictionary import RATE_TOLERANCE, Dictionary, body_frames
from mocapclean.dictionaries.training_parameters import Params
from mocapclean.errors import UsageError
from mocapclean.numerics import interpolation, windows
from mocapclean.numerics.coding.dictionary_learning import ksvd, learn_with_hidden_entries, scaled_to_use
from mocapclean.take import Take

# Fewest training windows for each atom; chosen by hand, so that no atom repeats a single window.
_SIGNALS_PER_ATOM = 4
# Sets of hidden markers in one missing-aware pass; chosen by hand for speed, each set has its own pursuit.
_HIDDEN_SETS = 8


def n_steps(parts: BodyParts, params: Params) -> int:
    """Return how often ``train`` calls ``tick``."""
    return len(_nonempty_parts(parts)) * (params.sweeps + params.hole_passes)


def train(
    takes: Sequence[Take],
    parts: BodyParts,
    params: Params,
    seed: int = 0,
    tick: Callable[[], None] = lambda: None,
) -> Dictionary:
    """Return the dictionary of takes that all have the markers of ``parts`` and one rate.

    It is learned from trusted samples alone. tick: called after every pass. Raises UsageError when markers or rates
    differ, or when no window or no pose is complete.
    """
    if not takes:
        raise UsageError("a dictionary must be trained on at least one take.")
    rng = np.random.default_rng(seed)
    _check(takes, parts)
    bodies = [_body(take, parts) for take in takes]
    names = parts.markers
    atoms = {}
    for part in _nonempty_parts(parts):
        columns = np.array([names.index(name) for name in parts.parts[part]])
        own = [(positions[:, columns], np.asarray(usable[:, columns].all(axis=1))) for positions, usable in bodies]
        signals = _signals(own, part, params, rng)
        atoms[part] = _learn(signals, len(columns), params, rng, tick)
    n_frames = sum(len(positions) for positions, _ in bodies)
    return Dictionary(
        parts=parts,
        rate=takes[0].rate,
        window=params.window,
        atoms=atoms,
        poses=_poses(bodies, params, rng),
        parameters={**asdict(params), "seed": seed, "takes": len(takes), "frames": n_frames},
    )


def _nonempty_parts(parts: BodyParts) -> list[str]:
    """Return the parts that have markers."""
    return [part for part in PARTS if parts.parts[part]]


def _check(takes: Sequence[Take], parts: BodyParts) -> None:
    """Raise UsageError unless all takes have the markers of the parts, and one rate."""
    for take in takes:
        source = f"{take.origin.path}: " if take.origin else ""
        names = set(distinct_bare_names(take.markers))
        lacking = [name for name in parts.markers if name not in names]
        if lacking:
            raise UsageError(f"{source}a training take must have all markers of the body. Got none named {lacking[0]}.")
        if abs(take.rate - takes[0].rate) > RATE_TOLERANCE * takes[0].rate:
            raise UsageError(
                f"{source}training takes must have one rate. Got {take.rate:g} Hz after {takes[0].rate:g} Hz."
            )


def _body(take: Take, parts: BodyParts) -> tuple[Floats, Bools]:
    """Return positions (F, M, 3) in the body's own frame, and the samples (F, M) that are usable for training.

    These are the trusted samples of the frames in which all landmarks are trusted.
    """
    column_of = {name: column for column, name in enumerate(distinct_bare_names(take.markers))}
    columns = np.array([column_of[name] for name in parts.markers])
    trusted = take.trusted[:, columns]
    positions = interpolation.linear(take.positions[:, columns], trusted)
    frames = body_frames(parts, positions, np.ones_like(trusted), positions)
    marks = [parts.markers.index(name) for group in parts.landmarks for name in group]
    usable: Bools = trusted & np.all(trusted[:, marks], axis=1, keepdims=True)
    return frames.to_local(positions), usable


def _signals(bodies: list[tuple[Floats, Bools]], part: str, params: Params, rng: np.random.Generator) -> Floats:
    """Return complete windows (N, L·3m) of a part, drawn at random from all takes.

    bodies: positions (F, m, 3) of the part's markers and the frames (F,) in which all of them are usable.
    """
    length = params.window
    # First frames of the complete windows of each take: those with ``length`` usable frames from there on
    first = []
    for positions, usable in bodies:
        count = np.concatenate(([0], np.cumsum(usable)))
        complete = count[length:] - count[:-length] == length if len(positions) >= length else np.zeros(0, dtype=bool)
        first.append(np.flatnonzero(complete))
    total = sum(map(len, first))
    if not total:
        raise UsageError(f"the training takes must hold {length} frames in a row in which all of {part} is trusted.")
    drawn = np.sort(rng.choice(total, min(params.windows, total), replace=False))
    bounds = np.cumsum([0, *map(len, first)])  # of each take in the numbers drawn
    return np.concatenate(
        [
            windows.cut(positions.reshape(len(positions), -1), f[drawn[(drawn >= low) & (drawn < high)] - low], length)
            for (positions, _), f, low, high in zip(bodies, first, bounds[:-1], bounds[1:], strict=True)
        ]
    )


def _learn(
    signals: Floats, n_markers: int, params: Params, rng: np.random.Generator, tick: Callable[[], None]
) -> Floats:
    """Return the atoms (K, L·3m) of a part from its windows (N, L·3m)."""
    # RMS norm 1
    scale = float(np.sqrt(np.mean(np.sum(signals**2, axis=1)))) or 1.0
    signals = signals / scale
    n_atoms = max(min(params.atoms, len(signals) // _SIGNALS_PER_ATOM), 1)
    atoms = ksvd(signals, n_atoms, params.sparsity, params.sweeps, rng, tick)
    for _ in range(params.hole_passes):
        hidden_markers = np.zeros((_HIDDEN_SETS, n_markers), dtype=bool)
        for row in hidden_markers:
            row[rng.choice(n_markers, round(params.hole_share * n_markers), replace=False)] = True
        hidden = np.tile(np.repeat(hidden_markers, 3, axis=1), params.window)
        pattern = rng.integers(len(hidden_markers), size=len(signals))
        atoms = learn_with_hidden_entries(atoms, signals, hidden, pattern, params.sparsity, params.hole_weight)
        tick()
    return scale * scaled_to_use(atoms, signals, params.sparsity)


def _poses(bodies: list[tuple[Floats, Bools]], params: Params, rng: np.random.Generator) -> Floats:
    """Return complete poses (P, M, 3), drawn at random from all takes."""
    complete = np.concatenate([positions[usable.all(axis=1)] for positions, usable in bodies])
    if not len(complete):
        raise UsageError("the training takes must hold a frame in which all markers are trusted.")
    drawn = np.sort(rng.choice(len(complete), min(params.poses, len(complete)), replace=False))
    return complete[drawn]
