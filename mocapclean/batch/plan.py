"""Inputs -> jobs: what is written where, refused as a whole before anything is begun that would lose a file."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from mocapclean.batch.inputs import Input, shard
from mocapclean.batch.journal import Before
from mocapclean.batch.repairing import Job, inode
from mocapclean.config.settings import Settings
from mocapclean.errors import UsageError
from mocapclean.files import check_output

Identity = tuple[int, int]


def plan(
    inputs: Sequence[Input],
    settings: Settings,
    kept: Iterable[Path],
    known: Mapping[str, Before],
    part: tuple[int, int] | None = None,
    *,
    resume: bool = False,
) -> list[Job]:
    """A job for each input, or each of a shard's; UsageError where one would write what another does, or must not.

    kept: other files that must not be written to. known: outputs of earlier runs, which this one may replace. part:
    (i, n) for shard i of n; the others' outputs may be there already. resume: a foreign file in the place of an output
    fails its take only.
    """
    if settings.output and (len(inputs) > 1 or settings.out_dir):
        raise UsageError("--output takes one input and no --out-dir. Use --out-dir for several.")
    jobs = [_job(found, settings, known, alone=len(inputs) == 1) for found in inputs]
    _check_places(jobs, settings)
    identities = _identities((*(found.path for found in inputs), *kept))
    if part:
        mine = set(shard(inputs, *part))
        jobs = [job for found, job in zip(inputs, jobs, strict=True) if found in mine]
    for job in jobs:
        _check_format(job)
        for target in job.targets:
            _check_target(target, identities, settings.overwrite or resume)
    if isinstance(settings.report, Path):
        _check_target(settings.report, identities, settings.overwrite or report_name(settings.report) in known)
    return jobs


def report_name(report: Path) -> str:
    """What the report of a run is called in its journal."""
    return os.path.abspath(report)


def make_folders(jobs: Iterable[Job], out_dir: Path | None) -> None:
    """Make the folders of all outputs; UsageError where that cannot be."""
    folders = [out_dir, *(job.output.parent for job in jobs)] if out_dir else []
    for folder in dict.fromkeys([*folders, *(job.sidecar.parent for job in jobs if job.sidecar)]):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as fault:
            raise UsageError(f"{folder}: the folder cannot be made: {fault.strerror or fault}.") from None


def _job(found: Input, settings: Settings, known: Mapping[str, Before], *, alone: bool) -> Job:
    """The job of an input; ``alone``: whether it is the only one."""
    source = found.path
    output = settings.output or source.with_name(f"{source.stem}_filled{source.suffix}")
    name = str(output)
    if settings.out_dir:
        output, name = settings.out_dir / found.relative, found.relative.as_posix()
    report = output.with_suffix(".report.json") if settings.report is True else None
    return Job(
        name=name,
        source=source,
        output=output,
        sidecar=_sidecar(found, settings.sidecar, alone) if settings.sidecar else None,
        report=report,
        before=known.get(name),
        inode=inode(output),
    )


def _sidecar(found: Input, sidecar: Path, alone: bool) -> Path:
    if sidecar.suffix not in ("", ".npz") and not sidecar.is_dir():
        raise UsageError(f"{sidecar}: --sidecar must be an .npz file, or a folder.")
    if sidecar.suffix == ".npz" and not alone:
        raise UsageError(f"{sidecar}: --sidecar takes a folder for several inputs.")
    return sidecar if sidecar.suffix == ".npz" else sidecar / found.relative.with_suffix(".npz")


def _check_places(jobs: Iterable[Job], settings: Settings) -> None:
    """Raise UsageError where two results would be one file, or a link leads one out of its folder."""
    real: dict[Path, str] = {}
    seen: set[str] = set()
    for target, top in _targets(jobs, settings):
        if target.parent not in real:
            real[target.parent] = os.path.realpath(target.parent)
        folder = real[target.parent]
        if top and os.path.commonpath([os.path.realpath(top), folder]) != os.path.realpath(top):
            raise UsageError(f"{target}: the output must stay in {top}. A link leads to {folder}.")
        place = os.path.normcase(os.path.join(folder, target.name))
        if place in seen:
            raise UsageError(f"{target}: two results would have this name. Use different names or folders.")
        seen.add(place)


def _targets(jobs: Iterable[Job], settings: Settings) -> Iterator[tuple[Path, Path | None]]:
    """All files that a run writes, each with the folder that it must stay in, if there is one."""
    for job in jobs:
        for target in job.targets:
            yield target, settings.out_dir if target != job.sidecar else None
    if isinstance(settings.report, Path):
        yield settings.report, None


def _check_format(job: Job) -> None:
    if job.output.suffix.lower() != job.source.suffix.lower():
        raise UsageError(f"{job.output}: the output must have the input's format, {job.source.suffix}.")


def _check_target(target: Path, kept: Mapping[Identity, Path], overwrite: bool) -> None:
    check_output(target, kept.get(_identity(target)), True)
    check_output(target, None, overwrite)


def _identities(paths: Iterable[Path]) -> dict[Identity, Path]:
    return {identity: path for path in paths if (identity := _identity(path)) != (0, 0)}


def _identity(path: Path) -> Identity:
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return 0, 0
    return found.st_dev, found.st_ino
