"""The declaration of a gap-filling method in its module, and the type of such a module."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

from mocapclean.geometry.skeleton import Bone
from mocapclean.parameters import fault_of as fault_of_params
from mocapclean.take import Solution


@dataclass(frozen=True, kw_only=True)
class Traits:
    """The needs and the results of a method; the defaults are those of most methods."""

    error_bars: bool = False
    """Whether the Solution has ``sd`` with the default parameters."""

    extrapolates: bool = True
    """Whether it fills gaps at the first and last frame of a take; else only gaps between two trusted samples."""

    gap_by_gap: bool = False
    """Whether it takes ``wanted``, and may leave the gaps without a wanted sample.

    It then also takes a Solution to begin with, or None: that of the take with more samples trusted.
    """

    needs_dictionary: bool = False
    """Whether it takes the dictionary that ``mocapclean train`` makes."""

    needs_bones: str = ""
    """The error where no bone length is known, ``{n_markers}`` in it; empty for a method that takes no bones."""

    cleans_complete_takes: bool = False
    """Whether, with its parameter ``denoise``, it also corrects a take in which nothing is missing."""

    self_checked: bool = False
    """Whether ``self_check: auto`` measures its error on hidden samples."""

    learns_from_session: bool = False
    """Whether it learns from the session of a take, ``Take.session``."""

    turns_joints: bool = False
    """Whether it fills the rotations of joints themselves; else their positions, to which poses are then fitted."""

    idle_facts: Mapping[str, float | int | str] = field(default_factory=dict)
    """The facts of its Solution where nothing can be filled."""


class KnownBones(NamedTuple):
    """The bones of a take whose lengths are known, and their source: "skeleton" or "rigid pairs"."""

    source: str
    bones: tuple[Bone, ...]


class Method(Protocol):
    """The module of a method; the docstring of the package lists the arguments of ``solve``."""

    __doc__: str | None
    REFERENCE: str
    TRAITS: Traits
    Params: type[Any]
    solve: Callable[..., Solution]


def fault_of(module: Any) -> str:
    """Return why the module of a method cannot be used, "" where it can."""
    if not isinstance(module.TRAITS, Traits):
        return "TRAITS must be of the type Traits"
    return fault_of_params(module.Params)


def limit_reached(params: Any, limit: str, state: str = "") -> str:
    """Return why an iteration stopped early: the parameter that limits it, and the state that it had come to."""
    return f"{limit} {getattr(params, limit)} reached" + (f"; {state}" if state else "")
