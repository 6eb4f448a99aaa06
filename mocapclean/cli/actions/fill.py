"""The action of ``mocapclean fill``: repair takes, and write them and their reports."""

import contextlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import click

from mocapclean.batch.inputs import SUFFIXES, find
from mocapclean.batch.journal import Journal, earlier_outputs
from mocapclean.batch.plan import make_folders, plan, report_name
from mocapclean.batch.pool import JobResults, Stop, run
from mocapclean.batch.repairing import FinishedTake, Repair, RepairJob, failed_outcome
from mocapclean.cli.actions.arguments import resolve_settings
from mocapclean.cli.actions.batching import TakeBar, one_take_alone, select_inputs, stopping, worker_limits
from mocapclean.cli.guard import INTERRUPTED, complain
from mocapclean.config.settings import Settings
from mocapclean.errors import MocapcleanError, UsageError, printable
from mocapclean.files import new_file
from mocapclean.pipeline.outcome import Outcome
from mocapclean.report import record
from mocapclean.report.text import totals


def work(
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
    only_missing: bool,
    **options: Any,
) -> int:
    """Repair takes, and write them and their reports; return the exit code."""
    if no_report:
        options["report"] = False
    if only_missing:
        if options["replace"] not in (None, "missing"):
            raise UsageError(f"--only-missing and --replace {options['replace']} contradict each other. Give one.")
        options["replace"] = "missing"
    settings = resolve_settings(config, assignments, options)
    if (resume or shard) and not settings.out_dir:
        raise UsageError("--resume and --shard need --out-dir.")
    if settings.html:
        from mocapclean.report.page.building import require_library

        require_library()
    if settings.scheduler:
        settings = settings.absolute()
    inputs = select_inputs(files, files_from, null, relative_to, settings)
    earlier = earlier_outputs(settings.out_dir) if resume and settings.out_dir else {}
    learnt_from = _learnt_from(settings)
    protected = [settings.skeleton, settings.dictionary, settings.gaps, settings.reference, config, *learnt_from]
    jobs = plan(inputs, settings, filter(None, protected), earlier, shard, resume=resume)
    make_folders(jobs, settings.out_dir)
    with (
        stopping(on_cluster=bool(settings.scheduler)) as stop,
        _repairing(settings, learnt_from) as repairing,
        _journal(settings, shard, len(jobs)) as journal,
    ):
        with contextlib.closing(_begin(repairing, jobs, journal, settings, stop)) as results:
            n_earlier = _collect(results, jobs, journal, settings, as_json)
        code = _conclude(jobs, journal, settings, as_json, n_earlier)
        if settings.html:
            _write_html(
                settings.html, jobs, journal, in_one_file=not (resume or shard), quiet=settings.quiet or as_json
            )
    if journal.fault:
        complain(f"{journal.fault} The report is complete, but --resume will repeat some takes.")
    if stop.signal:
        complain(INTERRUPTED)
    return 128 + stop.signal if stop.signal else code


def _learnt_from(settings: Settings) -> list[Path]:
    """Return the files to learn from, of ``settings.learn_from``; raise UsageError if a folder holds none."""
    paths = [each.path for each in find(settings.learn_from, skip=settings.out_dir)]
    if settings.learn_from and not paths:
        raise UsageError(f"--learn-from must hold at least one take ({', '.join(SUFFIXES)}). Got none.")
    return paths


@contextlib.contextmanager
def _repairing(settings: Settings, learnt_from: list[Path]) -> Iterator[Repair]:
    """Yield the work of the run; the takes to learn from are read once, into a file that all its processes read.

    The file is in a temporary folder, or for a cluster in the output folder, which its machines share.
    """
    if not learnt_from:
        yield Repair(settings)
        return
    import tempfile  # only for this case

    from mocapclean.pipeline.session import read_session, save_session

    takes = read_session(learnt_from, settings)
    shared = settings.out_dir if settings.scheduler else None
    with tempfile.TemporaryDirectory(prefix=".mocapclean-", dir=shared) as folder:
        session = Path(folder, "session.npz")
        save_session(session, takes)
        yield Repair(settings, session, tuple(each.sha256 for each in takes))


def _begin(
    work: Repair, jobs: list[RepairJob], journal: Journal, settings: Settings, stop: Stop
) -> JobResults[RepairJob, FinishedTake]:
    """Return the results of the jobs, run on this machine or on the cluster of ``settings.scheduler``."""
    limits = worker_limits(settings, alone=len(jobs) == 1)
    one_take_alone(len(jobs), limits, quiet=settings.quiet)
    if not settings.scheduler:
        return run(work, _journaled(jobs, journal), limits, stop)
    from mocapclean.batch import cluster

    shared = [*(job.source for job in jobs[:1]), *dict.fromkeys(job.output.parent for job in jobs)]
    jobs = [replace(job, may_rerun=True) for job in jobs]
    return cluster.run(work, _journaled(jobs, journal), settings.scheduler, limits, shared, stop)


def _journaled(jobs: Iterable[RepairJob], journal: Journal) -> Iterator[RepairJob]:
    """Yield the jobs, each recorded in the journal first unless an earlier run has recorded it."""
    for job in jobs:
        if job.earlier is None:
            journal.begin(job.name)
        yield job


@contextlib.contextmanager
def _journal(settings: Settings, shard: tuple[int, int] | None, n_takes: int) -> Iterator[Journal]:
    """Yield the journal of the run: in the output folder, one per shard.

    Without --out-dir it is in a temporary folder, and that of one take is in memory.
    """
    name = "journal-{}-of-{}".format(*shard) if shard else "journal"
    with contextlib.ExitStack() as stack:
        folder = settings.out_dir
        if folder is None and n_takes > 1:
            import tempfile  # only for this case

            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="mocapclean-")))
        yield stack.enter_context(Journal(folder, name))


def _collect(
    results: Iterable[tuple[RepairJob, FinishedTake | MocapcleanError]],
    jobs: list[RepairJob],
    journal: Journal,
    settings: Settings,
    as_json: bool,
) -> int:
    """Journal and print each result when it arrives; return the number of takes that an earlier run had finished."""
    n_failed = n_earlier = 0
    with TakeBar(len(jobs), quiet=settings.quiet) as bar:
        for job, result in results:
            if isinstance(result, MocapcleanError):
                result = FinishedTake(row=record.row(failed_outcome(job, str(result))))
            if result.row is None:
                assert job.earlier is not None
                journal.adopt(job.name, job.earlier)
                n_earlier += 1
            else:
                journal.add(job.name, result.key, result.row)
            row = _row(job, journal)
            n_failed += row["status"] == "failed"
            with bar.aside():
                _print(row, result, settings, as_json)
            bar.advance(f"{n_failed} failed")
    return n_earlier


def _print(row: Mapping[str, Any], result: FinishedTake, settings: Settings, as_json: bool) -> None:
    """Print the error, and the row or the summary, of a finished take."""
    if row["error"]:
        complain(row["error"] if row["status"] == "failed" else f"{row['source']}: {row['error']}")
    if as_json:
        click.echo(record.line(row))
    elif result.summary and row["status"] != "failed" and not settings.quiet:
        click.echo(result.summary)


def _row(job: RepairJob, journal: Journal) -> Mapping[str, Any]:
    """Return the report row of a take: the journaled row with the paths of this run, or a row of status skipped."""
    row = journal.row(job.name)
    if row is None:
        error = f"{job.source}: not repaired, because the run was interrupted. Use --resume to continue."
        return record.row(Outcome(source=job.source, status="skipped", error=error, exit_code=1))
    paths = {"output": job.output, "sidecar": job.sidecar}
    return {**row, "source": str(job.source), **{name: row[name] and str(path) for name, path in paths.items()}}


def _write_html(page: Path, jobs: list[RepairJob], journal: Journal, *, in_one_file: bool, quiet: bool) -> None:
    """Write the page of the run. in_one_file: whether the data of few takes go into it, so that none lie beside it."""
    from mocapclean.report.page.building import PageTake, write_page
    from mocapclean.report.page.places import MOST_EMBEDDED, remove_data

    journal.begin(report_name(page))
    embed = in_one_file and len(jobs) <= MOST_EMBEDDED
    takes = [(_row(job, journal), job.page) for job in jobs]
    write_page(
        page,
        (
            PageTake(row=row, data=path if path and path.exists() and row["status"] != "failed" else None)
            for row, path in takes
        ),
        embed=embed,
    )
    if embed:
        remove_data(page, [path for _, path in takes if path])
    if not quiet:
        click.echo(printable(f"page in {page}"))


def _conclude(jobs: list[RepairJob], journal: Journal, settings: Settings, as_json: bool, n_earlier: int) -> int:
    """Write the report of the run, print its totals, and return its exit code."""
    if isinstance(settings.report, Path):
        journal.begin(report_name(settings.report))
        with new_file(settings.report) as part:
            record.write(part, (_row(job, journal) for job in jobs), settings.as_json())
    counts: Counter[str] = Counter()
    code = n_beyond = 0
    for job in jobs:
        row = _row(job, journal)
        n_beyond += row["status"] in ("repaired", "unchanged") and row["exit_code"] > 0
        code = max(code, row["exit_code"])
        counts[row["status"]] += 1
        if as_json and row["status"] == "skipped":
            click.echo(record.line(row))
    if len(jobs) != 1 and not settings.quiet and not as_json:
        click.echo(totals(counts, n_beyond, n_earlier, settings.report if isinstance(settings.report, Path) else None))
    return code
