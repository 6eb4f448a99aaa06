"""``mocapclean bench``: the papers' experiments, resumable, with tables beside the printed values."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from tqdm import tqdm

from mocapclean import formats
from mocapclean.cli.guard import complain, guarded
from mocapclean.cli.options import FILE
from mocapclean.config.settings import MILLIMETRES
from mocapclean.dictionaries.dictionary import load
from mocapclean.errors import MocapcleanError, UsageError
from mocapclean.experiments import plots
from mocapclean.experiments.jobs import Capture, Choice, Job
from mocapclean.experiments.protocols import EXPERIMENTS, Experiment
from mocapclean.experiments.published import statements
from mocapclean.experiments.results import Results
from mocapclean.experiments.store import Store
from mocapclean.files import new_file
from mocapclean.report.text import table
from mocapclean.take import ReadOptions

_SUFFIXES = formats.suffixes()


@click.command("bench")
@click.argument("experiment", type=click.Choice(list(EXPERIMENTS)))
@click.argument("files", nargs=-1, type=FILE, metavar="[FILES]...")
@click.option("--folder", type=FILE, help="Takes: where FILES are looked for, or all that the paper uses.")
@click.option("--quick", is_flag=True, help="Fewer cells, methods and frames: a figure in about a minute.")
@click.option("--seeds", type=click.IntRange(min=1), help="Repetitions with other losses (default: 3; 1 with --quick).")
@click.option("--methods", multiple=True, metavar="NAME", help="Only these methods; also others than the paper's.")
@click.option("--set", "assignments", multiple=True, metavar="METHOD.KEY=VALUE", help="A parameter of a method.")
@click.option("--dictionary", type=FILE, help="What 'mocapclean train' wrote, for llc and srmmp.")
@click.option("--skeleton", type=FILE, help="The .asf of the .amc files, where it does not lie beside them.")
@click.option("--rate", type=float, help="Frames per second, for files that do not say (AMC: 120).")
@click.option(
    "--unit", default="cm", show_default=True, help="Unit of length of BVH files: mm, cm, m, in, or mm per unit."
)
@click.option(
    "--out-dir", type=FILE, default="bench", show_default=True, help="Results; a run goes on from what is there."
)
@click.option("--overwrite", is_flag=True, help="Forget the experiment's results and start anew.")
@click.option("--plots/--no-plots", "wants_plots", default=True, help="Draw figures; needs the extra 'plots'.")
@guarded
def command(
    experiment: str,
    files: tuple[Path, ...],
    folder: Path | None,
    quick: bool,
    seeds: int | None,
    methods: tuple[str, ...],
    assignments: tuple[str, ...],
    dictionary: Path | None,
    skeleton: Path | None,
    rate: float | None,
    unit: str,
    out_dir: Path,
    overwrite: bool,
    wants_plots: bool,
) -> int:
    """Run one of the papers' EXPERIMENTs on FILES (.c3d, .bvh, .amc), which are taken for the truth.

    Writes EXPERIMENT.csv (one row for each finished job), .json, .txt and figures. Ctrl-C keeps the finished rows; the
    same command goes on from there.
    """
    chosen = EXPERIMENTS[experiment]
    options = _reading(skeleton, rate, unit)
    choice = Choice(
        captures=_captures(files, folder, chosen, options),
        methods=tuple(name.strip() for part in methods for name in part.split(",") if name.strip()),
        changes=_changes(assignments),
        n_seeds=seeds or (1 if quick else 3),
        quick=quick,
        folder=tuple(_folder(folder, options)) if folder else (),
        dictionary=load(dictionary) if dictionary else None,
    )
    notes, jobs = _notes(chosen, choice), chosen.jobs(choice)
    store = Store(out_dir, experiment, chosen.measures, overwrite)
    failed = _run(jobs, store)
    results = store.results(jobs)
    text = _text(experiment, chosen, results, notes)
    _write(out_dir / f"{experiment}.txt", text)
    _write(out_dir / f"{experiment}.json", _json(experiment, chosen, results, notes))
    click.echo(text, nl=False)
    if wants_plots:
        _draw(chosen, results, out_dir)
    return int(failed > 0)


def _notes(chosen: Experiment, choice: Choice) -> list[str]:
    seeds = f"{choice.n_seeds} seed{'s' if choice.n_seeds > 1 else ''}"
    frames = f", the first {chosen.quick_frames} frames of each take" if chosen.quick_frames else ""
    quick = f", quick: fewer cells{frames}" if choice.quick else ""
    return [f"{seeds}{quick}", *chosen.notes(choice)]


def _run(jobs: Sequence[Job], store: Store) -> int:
    """Run what is not there yet; the number of jobs that failed, each kind of failure told once."""
    told: set[str] = set()
    failed = 0
    with tqdm(total=len(jobs), initial=sum(job in store for job in jobs), unit="job", disable=None) as bar:
        for job in jobs:
            if job in store:
                continue
            bar.set_postfix_str(f"{job.take} {job.entry.method}")
            try:
                found = job.run()
            except MocapcleanError as fault:
                failed += 1
                message = f"{job.take}, {job.entry.method}: {fault}"
                if message not in told:
                    told.add(message)
                    with tqdm.external_write_mode():
                        complain(message)
            else:
                store.add(job, found)
            bar.update()
    return failed


def _reading(skeleton: Path | None, rate: float | None, unit: str) -> ReadOptions:
    try:
        millimetres = MILLIMETRES[unit] if unit in MILLIMETRES else float(unit)
    except ValueError:
        raise UsageError(f"--unit must be {', '.join(MILLIMETRES)}, or millimetres per unit. Got {unit!r}.") from None
    return ReadOptions(skeleton=skeleton, rate=rate, unit=millimetres)


def _capture(path: Path, options: ReadOptions) -> Capture:
    return Capture(path=path, options=formats.declaration(path).applicable(options))


def _folder(folder: Path, options: ReadOptions) -> list[Capture]:
    """All takes of a folder, in the order of their names; UsageError for none."""
    if not folder.is_dir():
        raise UsageError(f"--folder must be a folder. Got {folder}.")
    found = [_capture(path, options) for path in sorted(folder.iterdir()) if path.suffix.lower() in _SUFFIXES]
    if not found:
        raise UsageError(f"{folder}: the folder must hold takes ({', '.join(_SUFFIXES)}). Got none.")
    return found


def _captures(
    files: tuple[Path, ...], folder: Path | None, chosen: Experiment, options: ReadOptions
) -> tuple[Capture, ...]:
    """The takes that are named, or the paper's among those of the folder, or all of them."""
    there = _folder(folder, options) if folder else []
    if files:
        captures = [_named(path, there, options) for path in files]
    else:
        captures = [capture for capture in there if capture.name in chosen.sequences] or there
    if not captures and chosen.needs_captures:
        raise UsageError("the experiment must have takes. Name files, or give a --folder.")
    names = [capture.name for capture in captures]
    for name in names:
        if names.count(name) > 1:
            raise UsageError(f"{name}: the takes of a run must have different names. Got it {names.count(name)} times.")
    return tuple(captures)


def _named(path: Path, there: Sequence[Capture], options: ReadOptions) -> Capture:
    """A file, or a take of the folder by its name with or without the suffix."""
    if path.is_file():
        return _capture(path, options)
    for capture in there:
        if str(path) in (capture.name, capture.path.name):
            return capture
    raise UsageError(f"{path}: a take must be a file, or the name of one in --folder. It is not there.")


def _changes(assignments: Sequence[str]) -> dict[str, dict[str, Any]]:
    changes: dict[str, dict[str, Any]] = {}
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        method, dot, key = name.partition(".")
        if not (equals and dot and method and key):
            raise UsageError(f"--set must be method.parameter=value. Got {assignment!r}.")
        try:
            value = YAML(typ="safe", pure=True).load(text) if text else ""
        except YAMLError:
            value = text
        changes.setdefault(method, {})[key] = value
    return changes


def _text(name: str, chosen: Experiment, results: Results, notes: Sequence[str]) -> str:
    lines = [f"{name}: {chosen.reference}", *notes]
    for found in chosen.tables(results):
        lines += ["", found.title, *table(found.rows, found.header)]
    said = statements(name)
    if said:
        lines += ["", "The paper says:", *(f"  - {statement}" for statement in said)]
    return "\n".join(lines) + "\n"


def _json(name: str, chosen: Experiment, results: Results, notes: Sequence[str]) -> str:
    rows = [
        {
            "take": row.take,
            "method": row.method,
            "variant": row.variant,
            "parameters": json.loads(row.parameters),
            "cell": dict(row.cell),
            "seed": row.seed,
            **row.values,
        }
        for row in results.rows
    ]
    tables = [{"title": t.title, "header": t.header, "rows": t.rows} for t in chosen.tables(results)]
    whole = {"experiment": name, "reference": chosen.reference, "notes": list(notes), "rows": rows, "tables": tables}
    return json.dumps(whole, indent=1, ensure_ascii=False) + "\n"


def _write(path: Path, text: str) -> None:
    with new_file(path) as part:
        part.write_text(text, encoding="utf-8")


def _draw(chosen: Experiment, results: Results, folder: Path) -> None:
    if not plots.can_draw():
        complain("no plots: matplotlib is not installed. Use pip install 'mocapclean[plots]', or --no-plots.")
        return
    for figure in chosen.figures(results):
        for path in plots.draw(figure, folder):
            click.echo(path)
