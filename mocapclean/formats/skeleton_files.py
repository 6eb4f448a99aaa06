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
    for stem in _stems(path):
        if stem in skeletons:
            return skeletons[stem]
    if len(skeletons) == 1:
        return next(iter(skeletons.values()))
    message = f"the skeleton ({suffix}) must lie beside it. Got {len(skeletons)} others; name it with --skeleton."
    raise FormatError(path, message)


def is_named_for(skeleton: Path, path: Path) -> bool:
    """Whether the name of a skeleton file is that of a take, or of a take less one or more ``_`` parts at the end."""
    return skeleton.stem.lower() in _stems(path)


def _stems(path: Path) -> list[str]:
    """Return the names that the skeleton file of a take may have, in lower case without suffix, the longest first."""
    parts = path.stem.lower().split("_")
    return ["_".join(parts[:number]) for number in range(len(parts), 0, -1)]


def new_skeleton_path(path: Path, suffix: str) -> Path:
    """Return where the skeleton of a new take goes: beside it, named by what comes before the first ``_``.

    The CMU database names files so: subject ``05`` in trial ``13`` is ``05_13.amc`` with ``05.asf``. All takes of a
    subject share one skeleton file.
    """
    subject = path.stem.partition("_")[0] or path.stem
    return path.with_name(subject + suffix)
