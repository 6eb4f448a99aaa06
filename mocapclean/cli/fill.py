"""``mocapclean fill``: repair takes, write them and their reports."""

from pathlib import Path
from typing import Any, NamedTuple

import click
from tqdm import tqdm

from mocapclean.cli.guard import complain, guarded
from mocapclean.cli.options import FILE, distinct, reading, settings
from mocapclean.config import Settings
from mocapclean.errors import UsageError
from mocapclean.formats import check_output, new_file
from mocapclean.records import Outcome
from mocapclean.repair import repair
from mocapclean.report.record import record, to_json
from mocapclean.report.text import summary


@click.command("fill")
@click.argument("files", nargs=-1, required=True, type=FILE)
@click.option("-o", "--output", type=FILE, help="The repaired file, for one input; same format as the input.")
@click.option("--out-dir", type=FILE, help="Folder for the repaired files, under their own names.")
@click.option("--overwrite/--no-overwrite", default=None, help="Replace outputs that exist.")
@click.option("--method", help="How to fill: one of 'mocapclean methods', or auto, which picks for each take.")
@click.option("--dictionary", type=FILE, help="What 'mocapclean train' wrote; llc and srmmp need it.")
@click.option("--max-gap", type=int, help="Leave gaps of more frames than this.")
@click.option("--max-error", type=float, metavar="MM", help="Leave gaps whose expected 3D error is larger.")
@click.option("--self-check/--no-self-check", default=None, help="Measure the error on hidden samples of the take.")
@click.option("--max-left", help="Exit 1 when more samples are left unfilled: a number, or a percentage such as 2%.")
@click.option(
    "--invalidate/--no-invalidate", default=None, help="Mark as missing (C3D) what is distrusted, not filled."
)
@click.option("--reference", type=FILE, help="The true take: adds the RMSE of the filled samples.")
@click.option("--report", type=FILE, help="Where the JSON report goes (default: beside each output).")
@click.option("--sidecar", type=FILE, help="Also write arrays (.npz): a file for one input, or a folder.")
@click.option("--no-report", is_flag=True, help="Write no report.")
@click.option("-q", "--quiet/--no-quiet", default=None, help="Print nothing but errors.")
@click.option("-v", "--verbose/--no-verbose", default=None, help="Print every gap and finding.")
@reading
@guarded
def command(
    files: tuple[Path, ...],
    config: Path | None,
    assignments: tuple[str, ...],
    no_report: bool,
    **options: Any,
) -> int:
    """Fill what cannot be trusted in FILES (.c3d, .bvh, .amc) and change nothing else.

    Writes take_filled.c3d and take_filled.report.json beside take.c3d unless told otherwise.
    """
    if no_report:
        options["report"] = False
    chosen = settings(config, assignments, options)
    jobs = plan(distinct(files), chosen, config)
    outcomes = []
    for job in tqdm(jobs, unit="take", disable=None if len(jobs) > 1 and not chosen.quiet else True):
        outcome = repair(job.source, job.output, chosen, job.sidecar)
        outcomes.append(outcome)
        if job.report and outcome.status != "failed":
            _write_report(job.report, [outcome], chosen)
        _tell(outcome, chosen, job)
    if isinstance(chosen.report, Path):
        _write_report(chosen.report, outcomes, chosen)
    return max(outcome.exit_code for outcome in outcomes)


class Job(NamedTuple):
    """An input and what it will be written to; report: its own one, if it has one."""

    source: Path
    output: Path
    sidecar: Path | None
    report: Path | None

    @property
    def targets(self) -> list[Path]:
        """All files that this job writes."""
        return [path for path in (self.output, self.sidecar, self.report) if path]


def plan(files: tuple[Path, ...], chosen: Settings, config: Path | None) -> list[Job]:
    """The jobs, or a UsageError before anything is written that would lose a file."""
    if chosen.output and (len(files) > 1 or chosen.out_dir):
        raise UsageError("--output takes one input and no --out-dir. Use --out-dir for several.")
    jobs = [_job(source, chosen, alone=len(files) == 1) for source in files]
    targets = [target for job in jobs for target in job.targets]
    if isinstance(chosen.report, Path):
        targets.append(chosen.report)
    named = [path for path in (chosen.skeleton, chosen.dictionary, chosen.gaps, chosen.reference, config) if path]
    for index, target in enumerate(targets):
        if target in targets[:index]:
            raise UsageError(f"{target}: two results would have this name. Use different names or folders.")
        for kept in (*files, *named):
            check_output(target, kept, True)
        check_output(target, None, chosen.overwrite)
    folders = [chosen.out_dir, *(job.sidecar.parent for job in jobs if job.sidecar)]
    for folder in dict.fromkeys(folders):
        if folder:
            _make(folder)
    return jobs


def _job(source: Path, chosen: Settings, *, alone: bool) -> Job:
    """One input's outputs; ``alone``: whether it is the only one."""
    output = chosen.output or _default_output(source, chosen)
    if chosen.output and output.suffix.lower() != source.suffix.lower():
        raise UsageError(f"{output}: the output must have the input's format, {source.suffix}.")
    sidecar = chosen.sidecar
    if sidecar and sidecar.suffix not in ("", ".npz") and not sidecar.is_dir():
        raise UsageError(f"{sidecar}: --sidecar must be an .npz file, or a folder.")
    if sidecar and sidecar.suffix == ".npz" and not alone:
        raise UsageError(f"{sidecar}: --sidecar takes a folder for several inputs.")
    if sidecar and sidecar.suffix != ".npz":
        sidecar = sidecar / f"{source.stem}.npz"
    report = output.with_suffix(".report.json") if chosen.report is True else None
    return Job(source, output, sidecar, report)


def _default_output(source: Path, chosen: Settings) -> Path:
    if chosen.out_dir:
        return chosen.out_dir / source.name
    return source.with_name(f"{source.stem}_filled{source.suffix}")


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise UsageError(f"{folder}: the folder cannot be made: {fault.strerror}.") from None


def _write_report(path: Path, outcomes: list[Outcome], chosen: Settings) -> None:
    with new_file(path) as part:
        part.write_text(to_json(record(outcomes, chosen.model_dump(mode="json"))), encoding="utf-8")


def _tell(outcome: Outcome, chosen: Settings, job: Job) -> None:
    if outcome.error:
        complain(outcome.error if outcome.status == "failed" else f"{outcome.source}: {outcome.error}")
    if chosen.quiet or outcome.status == "failed":
        return
    report = chosen.report if isinstance(chosen.report, Path) else job.report
    with tqdm.external_write_mode():
        click.echo(summary(outcome, verbose=chosen.verbose, report=report))
