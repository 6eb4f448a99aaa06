"""Learn a dictionary of a body's parts from clean takes.

For each part the windows of L frames, in the frame that travels with the body, are signals y of mean norm 1:

1. K-SVD: min ‖y − wᵀD‖² subject to ‖w‖₀ ≤ t, D of unit norm (M. Aharon et al., 2006).
2. Missing-aware passes (Z. Wang et al., 2016, eq. 2): some markers of each window are hidden; the codes come from what
   is left, the atoms from all of it, hidden entries weighing κ. The paper's ℓ1 codes are replaced by the t atoms of the
   first step, which spares a second parameter.
3. Atoms get the length and the sign that they have in use, for the local coding asks how near an atom is.

Z. Wang, Y. Feng, S. Liu, J. Xiao, X. Yang, J. J. Zhang, 2016, prints L, K and λ only; the other numbers are of
benchmarks/llc_sweep.csv.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import Bools, Floats
from mocapclean.dictionaries.body_parts import PARTS, BodyParts, bare_names
from mocapclean.dictionaries.dictionary import Dictionary, body_frames
from mocapclean.errors import UsageError
from mocapclean.numerics import interpolation, windows
from mocapclean.numerics.coding.dictionary_learning import ksvd, learn_holes, prototypes
from mocapclean.parameters import STRICT, About
from mocapclean.take import Take

_SIGNALS_PER_ATOM = 4
_PATTERNS = 8


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """How much is learnt and from how much."""

    window: Annotated[int, Field(ge=1), About(symbol="L", unit="frames", text="length of an atom")] = 30
    atoms: Annotated[
        int, Field(ge=1), About(symbol="K", text="most atoms of a part; one for 4 training windows at most")
    ] = 1024
    sparsity: Annotated[int, Field(ge=1), About(symbol="t", text="atoms that code a window in training")] = 4
    sweeps: Annotated[int, Field(ge=1), About(symbol="n", text="passes of K-SVD")] = 8
    windows: Annotated[int, Field(ge=1), About(symbol="N", text="most training windows of a part, drawn at random")] = (
        8192
    )
    hole_passes: Annotated[int, Field(ge=0), About(symbol="p", text="missing-aware passes after K-SVD")] = 2
    hole_share: Annotated[
        float, Field(ge=0, lt=1), About(symbol="h", text="share of a part's markers hidden in them")
    ] = 0.3
    hole_weight: Annotated[float, Field(ge=0), About(symbol="κ", text="weight of what is hidden")] = 0.1
    poses: Annotated[int, Field(ge=1), About(symbol="P", text="most training poses that are kept, drawn at random")] = (
        2000
    )


def n_steps(parts: BodyParts, params: Params) -> int:
    """How often ``train`` calls ``tick``."""
    return len(_inhabited(parts)) * (params.sweeps + params.hole_passes)


def train(
    takes: Sequence[Take],
    parts: BodyParts,
    params: Params,
    seed: int = 0,
    tick: Callable[[], None] = lambda: None,
) -> Dictionary:
    """Learn from takes that all have the markers of ``parts`` and one rate; tick is called after every pass.

    Only trusted samples are learnt from. Raises UsageError when the takes do not fit together, or hold no window or
    pose that is whole.
    """
    if not takes:
        raise UsageError("a dictionary must be trained on at least one take.")
    rng = np.random.default_rng(seed)
    _check(takes, parts)
    bodies = [_body(take, parts) for take in takes]
    names = parts.markers
    atoms = {}
    for part in _inhabited(parts):
        columns = np.array([names.index(name) for name in parts.parts[part]])
        whole = [(p[:, columns], np.asarray(u[:, columns].all(axis=1))) for p, u in bodies]
        signals = _signals(whole, part, params, rng)
        atoms[part] = _learn(signals, len(columns), params, rng, tick)
    return Dictionary(
        parts=parts,
        rate=takes[0].rate,
        window=params.window,
        atoms=atoms,
        poses=_poses(bodies, params, rng),
        parameters={**asdict(params), "seed": seed, "takes": len(takes), "frames": sum(len(p) for p, _ in bodies)},
    )


def _inhabited(parts: BodyParts) -> list[str]:
    return [part for part in PARTS if parts.parts[part]]


def _check(takes: Sequence[Take], parts: BodyParts) -> None:
    for take in takes:
        source = f"{take.origin.path}: " if take.origin else ""
        names = set(bare_names(take.markers))
        lacking = [name for name in parts.markers if name not in names]
        if lacking:
            raise UsageError(f"{source}a training take must have all markers of the body. Got none named {lacking[0]}.")
        if abs(take.rate - takes[0].rate) > 0.01 * takes[0].rate:
            raise UsageError(
                f"{source}training takes must have one rate. Got {take.rate:g} Hz after {takes[0].rate:g} Hz."
            )


def _body(take: Take, parts: BodyParts) -> tuple[Floats, Bools]:
    """Positions (F, M, 3) in the body's own frame, and which of them may be learnt from."""
    place = {name: column for column, name in enumerate(bare_names(take.markers))}
    columns = np.array([place[name] for name in parts.markers])
    trusted = take.trusted[:, columns]
    positions = interpolation.linear(take.positions[:, columns], trusted)
    frames = body_frames(parts, positions, np.ones_like(trusted), positions)
    marks = [parts.markers.index(name) for group in parts.landmarks for name in group]
    usable: Bools = trusted & np.all(trusted[:, marks], axis=1, keepdims=True)
    return frames.to_local(positions), usable


def _signals(bodies: list[tuple[Floats, Bools]], part: str, params: Params, rng: np.random.Generator) -> Floats:
    """Windows (N, L·3m) of a part without a hole, drawn at random from all takes."""
    length = params.window
    first = []
    for positions, usable in bodies:
        count = np.concatenate(([0], np.cumsum(usable)))
        whole = count[length:] - count[:-length] == length if len(positions) >= length else np.zeros(0, dtype=bool)
        first.append(np.flatnonzero(whole))
    total = sum(map(len, first))
    if not total:
        raise UsageError(f"the training takes must hold {length} frames in a row in which all of {part} is trusted.")
    drawn = np.sort(rng.choice(total, min(params.windows, total), replace=False))
    bounds = np.cumsum([0, *map(len, first)])
    return np.concatenate(
        [
            windows.cut(positions.reshape(len(positions), -1), f[drawn[(drawn >= low) & (drawn < high)] - low], length)
            for (positions, _), f, low, high in zip(bodies, first, bounds[:-1], bounds[1:], strict=True)
        ]
    )


def _learn(
    signals: Floats, n_markers: int, params: Params, rng: np.random.Generator, tick: Callable[[], None]
) -> Floats:
    scale = float(np.sqrt(np.mean(np.sum(signals**2, axis=1)))) or 1.0
    signals = signals / scale
    n_atoms = max(min(params.atoms, len(signals) // _SIGNALS_PER_ATOM), 1)
    atoms = ksvd(signals, n_atoms, params.sparsity, params.sweeps, rng, tick)
    for _ in range(params.hole_passes):
        holes = np.zeros((_PATTERNS, n_markers), dtype=bool)
        for row in holes:
            row[rng.choice(n_markers, round(params.hole_share * n_markers), replace=False)] = True
        hidden = np.tile(np.repeat(holes, 3, axis=1), params.window)
        pattern = rng.integers(len(holes), size=len(signals))
        atoms = learn_holes(atoms, signals, hidden, pattern, params.sparsity, params.hole_weight)
        tick()
    return scale * prototypes(atoms, signals, params.sparsity)


def _poses(bodies: list[tuple[Floats, Bools]], params: Params, rng: np.random.Generator) -> Floats:
    whole = np.concatenate([positions[usable.all(axis=1)] for positions, usable in bodies])
    if not len(whole):
        raise UsageError("the training takes must hold a frame in which all markers are trusted.")
    drawn = np.sort(rng.choice(len(whole), min(params.poses, len(whole)), replace=False))
    return whole[drawn]
