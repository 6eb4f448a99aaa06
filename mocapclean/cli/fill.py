"""``mocapclean fill``: repair takes, write them and their reports."""

import contextlib
import json
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import click
from tqdm import tqdm

from mocapclean.batch.journal import Journal, earlier
from mocapclean.batch.plan import make_folders, plan, report_name
from mocapclean.batch.pool import Answers, Stop, run
from mocapclean.batch.repairing import Done, Job, Repair, failed
from mocapclean.cli.batching import batching, limits, select, stopping
from mocapclean.cli.guard import INTERRUPTED, complain, guarded
from mocapclean.cli.options import FILE, reading, settings
from mocapclean.config.settings import Settings
from mocapclean.errors import MocapcleanError, UsageError
from mocapclean.files import new_file
from mocapclean.pipeline.outcome import Outcome
from mocapclean.report import record
from mocapclean.report.text import totals


@click.command("fill")
@click.argument("files", nargs=-1, type=FILE, metavar="[FILES]...")
@click.option("-o", "--output", type=FILE, help="The repaired file, for one input; same format as the input.")
@click.option("--out-dir", type=FILE, help="Folder for the repaired files, under their own names.")
@click.option("--overwrite/--no-overwrite", default=None, help="Replace outputs that exist.")
@click.option("--method", help="How to fill: one of 'mocapclean methods', or auto, which picks for each take.")
@click.option("--dictionary", type=FILE, help="What 'mocapclean train' wrote; llc and srmmp need it.")
@click.option("--max-gap", type=int, help="Leave gaps of more frames than this.")
@click.option("--max-error", type=float, metavar="MM", help="Leave gaps whose expected 3D error is larger.")
@click.option("--self-check/--no-self-check", default=None, help="Measure the error on hidden samples of the take.")
@click.option("--fix-swaps/--no-fix-swaps", default=None, help="Exchange swapped labels back, every number as it is.")
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
@click.option("--resume", is_flag=True, help="Skip what an earlier run into --out-dir has done, and is still so.")
@click.option("--json", "as_json", is_flag=True, help="Print each take's row of the report, one a line, as it is done.")
@batching
@reading
@guarded
def command(
    files: tuple[Path, ...],
    config: Path | None,
    assignments: tuple[str, ...],
    no_report: bool,
    files_from: BinaryIO | None,
    null: bool,
    relative_to: Path | None,
    shard: tuple[int, int] | None,
    resume: bool,
    as_json: bool,
    **options: Any,
) -> int:
    """Fill what cannot be trusted in FILES (.c3d, .bvh, .amc) and change nothing else.

    Writes take_filled.c3d and take_filled.report.json beside take.c3d unless told otherwise. FILES may be folders:
    every take in them, and the same tree under --out-dir.
    """
    if no_report:
        options["report"] = False
    chosen = settings(config, assignments, options)
    if (resume or shard) and not chosen.out_dir:
        raise UsageError("--resume and --shard need --out-dir.")
    if chosen.scheduler:
        chosen = chosen.absolute()
    inputs = select(files, files_from, null, relative_to, chosen)
    known = earlier(chosen.out_dir) if resume and chosen.out_dir else {}
    kept = [chosen.skeleton, chosen.dictionary, chosen.gaps, chosen.reference, config]
    jobs = plan(inputs, chosen, filter(None, kept), known, shard, resume=resume)
    make_folders(jobs, chosen.out_dir)
    with stopping() as stop, _journal(chosen, shard) as journal:
        with contextlib.closing(_begin(jobs, journal, chosen, stop)) as answers:
            n_earlier = _follow(answers, jobs, journal, chosen, as_json)
        code = _conclude(jobs, journal, chosen, as_json, n_earlier)
    if journal.fault:
        complain(f"{journal.fault} The report is complete, but --resume will not know of all takes.")
    if stop.signal:
        complain(INTERRUPTED)
    return 128 + stop.signal if stop.signal else code


def _begin(jobs: list[Job], journal: Journal, chosen: Settings, stop: Stop) -> Answers[Job, Done]:
    """Begin the work here, or on the cluster that is to do it."""
    work, most = Repair(chosen), limits(chosen, alone=len(jobs) == 1)
    if not chosen.scheduler:
        return run(work, _journaled(jobs, journal), most, stop)
    from mocapclean.batch import cluster

    shared = [*(job.source for job in jobs[:1]), *dict.fromkeys(job.output.parent for job in jobs)]
    again = [replace(job, again=True) for job in jobs]
    return cluster.run(work, _journaled(again, journal), chosen.scheduler, most, shared, stop)


def _journaled(jobs: Iterable[Job], journal: Journal) -> Iterator[Job]:
    """The jobs, each noted when it is taken, unless an earlier run has."""
    for job in jobs:
        if job.before is None:
            journal.begin(job.name)
        yield job


@contextlib.contextmanager
def _journal(chosen: Settings, shard: tuple[int, int] | None) -> Iterator[Journal]:
    """The journal in the output folder, for each shard its own; without one, somewhere for as long as the run."""
    name = "journal-{}-of-{}".format(*shard) if shard else "journal"
    with contextlib.ExitStack() as stack:
        folder = chosen.out_dir or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="mocapclean-")))
        yield stack.enter_context(Journal(folder, name))


def _follow(
    answers: Iterable[tuple[Job, Done | MocapcleanError]],
    jobs: list[Job],
    journal: Journal,
    chosen: Settings,
    as_json: bool,
) -> int:
    """Keep and tell each answer as it comes; how many takes an earlier run had done."""
    n_failed = n_earlier = 0
    with tqdm(total=len(jobs), unit="take", disable=None if len(jobs) > 1 and not chosen.quiet else True) as bar:
        for job, answer in answers:
            if isinstance(answer, MocapcleanError):
                answer = Done(take=record.row(failed(job, str(answer))))
            if answer.take is None:
                assert job.before is not None
                journal.take_over(job.name, job.before)
                n_earlier += 1
            else:
                journal.add(job.name, answer.key, answer.take)
            row = _row(job, journal)
            n_failed += row["status"] == "failed"
            with tqdm.external_write_mode():
                _tell(row, answer, chosen, as_json)
            bar.set_postfix_str(f"{n_failed} failed", refresh=False)
            bar.update()
    return n_earlier


def _tell(row: Mapping[str, Any], answer: Done, chosen: Settings, as_json: bool) -> None:
    if row["error"]:
        complain(row["error"] if row["status"] == "failed" else f"{row['source']}: {row['error']}")
    if as_json:
        click.echo(json.dumps(row, allow_nan=False))
    elif answer.text and row["status"] != "failed" and not chosen.quiet:
        click.echo(answer.text)


def _row(job: Job, journal: Journal) -> Mapping[str, Any]:
    """The one row of a take: what was journaled, under its present names, or that it was not done."""
    row = journal.row(job.name)
    if row is None:
        error = f"{job.source}: not begun, or dropped: the run was interrupted."
        return record.row(Outcome(source=job.source, status="skipped", error=error, exit_code=1))
    present = {"output": job.output, "sidecar": job.sidecar}
    return {**row, "source": str(job.source), **{name: row[name] and str(path) for name, path in present.items()}}


def _conclude(jobs: list[Job], journal: Journal, chosen: Settings, as_json: bool, n_earlier: int) -> int:
    """Write the report of the run, say how it went, and return the exit code."""
    if isinstance(chosen.report, Path):
        journal.begin(report_name(chosen.report))
        with new_file(chosen.report) as part:
            record.write(part, (_row(job, journal) for job in jobs), chosen.model_dump(mode="json"))
    counts: Counter[str] = Counter()
    code = 0
    for job in jobs:
        row = _row(job, journal)
        code = max(code, row["exit_code"])
        counts[row["status"]] += 1
        if as_json and row["status"] == "skipped":
            click.echo(json.dumps(row, allow_nan=False))
    if len(jobs) != 1 and not chosen.quiet and not as_json:
        click.echo(totals(counts, n_earlier, chosen.report if isinstance(chosen.report, Path) else None))
    return code
