"""The skeleton file that belongs to a take: where it is looked for, and its name when it is created."""

from pathlib import Path

from mocapclean.errors import FormatError


def find_skeleton(path: Path, suffix: str) -> Path:
    """Return the skeleton file of a take: in its folder, with the given suffix in any case.

    Its name is the take's own, or the take's own less one or more ``_`` parts at the end (``05_13.amc``: ``05_13.asf``,
    then ``05.asf``). A folder with a single skeleton file needs no such name. Raises FormatError if there is none.
    """
    try:
        skeletons = {p.stem.lower(): p for p in sorted(path.parent.iterdir()) if p.suffix.lower() == suffix}
    except OSError as error:
        raise FormatError(path, f"its folder must be readable. Got {error.strerror}.") from error
    stem = path.stem.lower()
    while stem not in skeletons and "_" in stem:
        stem = stem.rpartition("_")[0]
    if stem in skeletons:
        return skeletons[stem]
    if len(skeletons) == 1:
        return next(iter(skeletons.values()))
    raise FormatError(path, f"the skeleton ({suffix}) must lie beside it. Got {len(skeletons)} others; give it.")


def new_skeleton_path(path: Path, suffix: str) -> Path:
    """Return where the skeleton of a new take goes: beside it, named by what comes before the first ``_``.

    The CMU database names files so: subject ``05`` in trial ``13`` is ``05_13.amc`` with ``05.asf``. All takes of a
    subject share one skeleton file.
    """
    subject = path.stem.partition("_")[0] or path.stem
    return path.with_name(subject + suffix)
