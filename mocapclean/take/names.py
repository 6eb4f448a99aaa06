"""Names of markers: their subjects, patterns with wildcards, and names that are nearly alike."""

from collections.abc import Sequence
from difflib import get_close_matches
from fnmatch import fnmatchcase

# Characters that make a name a pattern for ``matching_columns``.
WILDCARDS = frozenset("*?[")
# Most names that a message suggests; chosen by hand.
MOST_SUGGESTIONS = 3


def split_subject(marker: str) -> tuple[str, str]:
    """Return the subject and the bare name of ``Subject:NAME``; the subject of a name without a colon is ""."""
    subject, _, name = marker.rpartition(":")
    return subject, name


def bare_name(marker: str) -> str:
    """Return the name of a marker without its subject."""
    return split_subject(marker)[1]


def is_pattern(name: str) -> bool:
    """Whether a name has wildcards: ``*``, ``?`` or ``[``."""
    return bool(set(name) & WILDCARDS)


def matching_columns(pattern: str, markers: Sequence[str]) -> list[int]:
    """Return the columns of the markers that a pattern matches, with or without their subjects.

    ``*``, ``?`` and ``[...]`` are wildcards as in ``fnmatch``, and case counts. A marker whose name is the pattern
    itself always matches.
    """
    return [
        column
        for column, marker in enumerate(markers)
        if marker == pattern or fnmatchcase(marker, pattern) or fnmatchcase(bare_name(marker), pattern)
    ]


def similar_names(name: str, markers: Sequence[str], *, cutoff: float = 0.6) -> list[str]:
    """Return up to 3 markers whose names are most like a name, best first; none below the ``cutoff``.

    Names that differ in case only, with or without their subject, come first. cutoff: the least ratio of
    ``difflib.SequenceMatcher`` without regard to case, from 0 to 1.
    """
    folded = name.casefold()
    same = [marker for marker in markers if folded in (marker.casefold(), bare_name(marker).casefold())]
    spelled: dict[str, list[str]] = {}
    for marker in markers:
        spelled.setdefault(marker.casefold(), []).append(marker)
    near = get_close_matches(folded, spelled, n=MOST_SUGGESTIONS, cutoff=cutoff)
    return list(dict.fromkeys([*same, *(marker for text in near for marker in spelled[text])]))[:MOST_SUGGESTIONS]
