"""``mocapclean fill``: repair takes, write them and their reports."""

from pathlib import Path
from typing import Any

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
@click.option("--method", help="How to fill; see 'mocapclean methods'.")
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
    for source, output in tqdm(jobs, unit="take", disable=None if len(jobs) > 1 and not chosen.quiet else True):
        outcome = repair(source, output, chosen)
        outcomes.append(outcome)
        if isinstance(chosen.report, bool) and chosen.report and outcome.status != "failed":
            _write_report(_beside(output), [outcome], chosen)
        _tell(outcome, chosen)
    if not isinstance(chosen.report, bool):
        _write_report(chosen.report, outcomes, chosen)
    return max(outcome.exit_code for outcome in outcomes)


def plan(files: tuple[Path, ...], chosen: Settings, config: Path | None) -> list[tuple[Path, Path]]:
    """Inputs and outputs, or a UsageError before anything is written that would lose a file."""
    if chosen.output and (len(files) > 1 or chosen.out_dir):
        raise UsageError("--output takes one input and no --out-dir. Use --out-dir for several.")
    jobs = [(source, chosen.output or _default_output(source, chosen)) for source in files]
    named = [path for path in (chosen.skeleton, chosen.dictionary, chosen.gaps, chosen.reference, config) if path]
    targets = [output for _, output in jobs]
    for source, output in jobs:
        if chosen.output and output.suffix.lower() != source.suffix.lower():
            raise UsageError(f"{output}: the output must have the input's format, {source.suffix}.")
    if isinstance(chosen.report, Path):
        targets.append(chosen.report)
    elif chosen.report:
        targets += [_beside(output) for _, output in jobs]
    for index, target in enumerate(targets):
        if target in targets[:index]:
            raise UsageError(f"{target}: two results would have this name. Use different names or folders.")
        for kept in (*files, *named):
            check_output(target, kept, True)
        check_output(target, None, chosen.overwrite)
    if chosen.out_dir:
        _make(chosen.out_dir)
    return jobs


def _default_output(source: Path, chosen: Settings) -> Path:
    if chosen.out_dir:
        return chosen.out_dir / source.name
    return source.with_name(f"{source.stem}_filled{source.suffix}")


def _beside(output: Path) -> Path:
    return output.with_suffix(".report.json")


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise UsageError(f"{folder}: the folder cannot be made: {fault.strerror}.") from None


def _write_report(path: Path, outcomes: list[Outcome], chosen: Settings) -> None:
    with new_file(path) as part:
        part.write_text(to_json(record(outcomes, chosen.model_dump(mode="json"))), encoding="utf-8")


def _tell(outcome: Outcome, chosen: Settings) -> None:
    if outcome.error:
        complain(outcome.error if outcome.status == "failed" else f"{outcome.source}: {outcome.error}")
    if chosen.quiet or outcome.status == "failed":
        return
    report = None
    if outcome.output and chosen.report is not False:
        report = chosen.report if isinstance(chosen.report, Path) else _beside(outcome.output)
    with tqdm.external_write_mode():
        click.echo(summary(outcome, verbose=chosen.verbose, report=report))
