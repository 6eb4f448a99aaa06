"""Plan a run: one job per input, with all its outputs; refuse a plan that would lose a file."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from mocapclean.batch.inputs import Input, shard
from mocapclean.batch.journal import EarlierOutput
from mocapclean.batch.repairing import RepairJob, inode
from mocapclean.config.settings import Settings
from mocapclean.errors import UsageError
from mocapclean.files import check_output, make_folder
from mocapclean.report.page.places import data_file

FileIdentity = tuple[int, int]
"""Device and inode of a file; (0, 0) if it does not exist."""


def plan(
    inputs: Sequence[Input],
    settings: Settings,
    protected: Iterable[Path],
    earlier: Mapping[str, EarlierOutput],
    part: tuple[int, int] | None = None,
    *,
    resume: bool = False,
) -> list[RepairJob]:
    """Return a job for each input of the run or of its shard.

    protected: further files that must not be written to. earlier: outputs of earlier runs, which this run may replace.
    part: (i, n) for shard i of n. resume: a foreign file in the place of an output fails only its own take.
    Raises UsageError if two jobs would write the same file, or if one would write to an input or an existing file.
    """
    if settings.output and (len(inputs) > 1 or settings.out_dir):
        raise UsageError("--output takes one input and no --out-dir. Use --out-dir for several.")
    jobs = [_job(each, settings, earlier, alone=len(inputs) == 1) for each in inputs]
    _check_targets_differ(jobs, settings)
    identities = _identities((*(each.path for each in inputs), *protected))
    if part:
        mine = set(shard(inputs, *part))
        jobs = [job for each, job in zip(inputs, jobs, strict=True) if each in mine]
    for job in jobs:
        _check_format(job)
        for target in job.targets:
            _check_target(target, identities, settings.overwrite or resume)
    for path in _of_run(settings):
        _check_target(path, identities, settings.overwrite or report_name(path) in earlier)
    return jobs


def _of_run(settings: Settings) -> Iterator[Path]:
    """Yield the report and the page of the whole run, where there are such."""
    if isinstance(settings.report, Path):
        yield settings.report
    if settings.html:
        yield settings.html


def report_name(report: Path) -> str:
    """Return the name of a run's report or page in its journal."""
    return os.path.abspath(report)


def make_folders(jobs: Iterable[RepairJob], out_dir: Path | None) -> None:
    """Make the folders of all outputs; raise UsageError for a folder that cannot be made."""
    folders = [out_dir, *(job.output.parent for job in jobs)] if out_dir else []
    beside = [path.parent for job in jobs for path in (job.sidecar, job.page) if path]
    for folder in dict.fromkeys([*folders, *beside]):
        make_folder(folder)


def _job(take: Input, settings: Settings, earlier: Mapping[str, EarlierOutput], *, alone: bool) -> RepairJob:
    """Return the job of an input. alone: whether it is the only input of the run."""
    source = take.path
    output = settings.output or source.with_name(f"{source.stem}_filled{source.suffix}")
    name = str(output)
    if settings.out_dir:
        output, name = settings.out_dir / take.relative, take.relative.as_posix()
    report = output.with_name(f"{output.name}.report.json") if settings.report is True else None
    return RepairJob(
        name=name,
        source=source,
        output=output,
        sidecar=_sidecar(take, settings.sidecar, alone) if settings.sidecar else None,
        report=report,
        page=data_file(settings.html, name) if settings.html else None,
        earlier=earlier.get(name),
        planned_inode=inode(output),
    )


def _sidecar(take: Input, sidecar: Path, alone: bool) -> Path:
    """Return the path of the arrays of an input: ``sidecar`` itself, or a file below it if it is a folder."""
    if sidecar.suffix not in ("", ".npz") and not sidecar.is_dir():
        raise UsageError(f"{sidecar}: --sidecar must be an .npz file, or a folder.")
    if sidecar.suffix == ".npz" and not alone:
        raise UsageError(f"{sidecar}: --sidecar takes a folder for several inputs.")
    return sidecar if sidecar.suffix == ".npz" else sidecar / take.relative.with_name(f"{take.relative.name}.npz")


def _check_targets_differ(jobs: Iterable[RepairJob], settings: Settings) -> None:
    """Raise UsageError if two targets are the same file, or if a link leads a target out of its folder."""
    real_folders: dict[Path, str] = {}
    seen: set[str] = set()
    for target, top in _targets(jobs, settings):
        if target.parent not in real_folders:
            real_folders[target.parent] = os.path.realpath(target.parent)
        folder = real_folders[target.parent]
        if top and not Path(folder).is_relative_to(os.path.realpath(top)):
            raise UsageError(f"{target}: the output must stay in {top}. A link leads to {folder}.")
        real_path = os.path.normcase(os.path.join(folder, target.name))
        if real_path in seen:
            raise UsageError(f"{target}: two results would have this name. Use different names or folders.")
        seen.add(real_path)


def _targets(jobs: Iterable[RepairJob], settings: Settings) -> Iterator[tuple[Path, Path | None]]:
    """Yield every file that a run writes, with the folder that it must stay in (None: any folder)."""
    for job in jobs:
        for target in job.targets:
            yield target, settings.out_dir if target not in (job.sidecar, job.page) else None
    for path in _of_run(settings):
        yield path, None


def _check_format(job: RepairJob) -> None:
    """Raise UsageError if the output has another format than the input."""
    if job.output.suffix.lower() != job.source.suffix.lower():
        raise UsageError(f"{job.output}: the output must have the input's format, {job.source.suffix}.")


def _check_target(target: Path, protected: Mapping[FileIdentity, Path], overwrite: bool) -> None:
    """Raise UsageError if a target is a protected file, or exists and may not be replaced."""
    check_output(target, protected.get(_identity(target)), True)
    check_output(target, None, overwrite)


def _identities(paths: Iterable[Path]) -> dict[FileIdentity, Path]:
    """Return the existing files among ``paths`` by identity."""
    return {identity: path for path in paths if (identity := _identity(path)) != (0, 0)}


def _identity(path: Path) -> FileIdentity:
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return 0, 0
    return status.st_dev, status.st_ino
