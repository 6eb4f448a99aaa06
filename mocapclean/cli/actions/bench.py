"""The action of ``mocapclean bench``: run the papers' experiments, and show the results beside the printed values."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
from tqdm import tqdm

from mocapclean import formats
from mocapclean.cli.actions.arguments import millimetres, takes_in
from mocapclean.cli.guard import complain
from mocapclean.config.yaml_files import scalar
from mocapclean.dictionaries.dictionary import load
from mocapclean.errors import MocapcleanError, UsageError
from mocapclean.experiments import plots
from mocapclean.experiments.experiment import Experiment
from mocapclean.experiments.protocols import EXPERIMENTS
from mocapclean.experiments.published import statements
from mocapclean.experiments.results import Results
from mocapclean.experiments.store import Store
from mocapclean.experiments.trials import Capture, Request, Trial
from mocapclean.files import new_file
from mocapclean.report.text import table
from mocapclean.take import ReadOptions


def work(
    experiment: str,
    files: tuple[Path, ...],
    folder: Path | None,
    quick: bool,
    seeds: int | None,
    most_frames: int | None,
    mask_from: tuple[Path, ...],
    methods: tuple[str, ...],
    assignments: tuple[str, ...],
    dictionary: Path | None,
    skeleton: Path | None,
    rate: float | None,
    unit: str | None,
    out_dir: Path,
    overwrite: bool,
    wants_plots: bool,
) -> int:
    """Run an experiment, write its results and print them; return the exit code."""
    files = tuple(take for path in files for take in (takes_in([path]) if path.is_dir() else [path]))
    chosen = EXPERIMENTS[experiment].EXPERIMENT
    unit = unit or (None if chosen.infers_unit else "cm")
    options = ReadOptions(skeleton=skeleton, rate=rate, unit=millimetres(unit) if unit else None)
    in_folder = _folder(folder, options) if folder else []
    if mask_from and not chosen.gappy:
        raise UsageError(f"--mask-from must be left out: {experiment} hides no natural gaps of other captures.")
    request = Request(
        captures=_shortened(_captures(files, in_folder, chosen, options), most_frames),
        methods=tuple(name.strip() for part in methods for name in part.split(",") if name.strip()),
        changes=_changes(assignments),
        n_seeds=seeds or (1 if quick else 3),
        quick=quick,
        folder=_shortened(in_folder, most_frames),
        dictionary=load(dictionary) if dictionary else None,
        masks=_masks(mask_from, in_folder, chosen, options),
    )
    notes, trials = _notes(chosen, request, most_frames), chosen.trials(request)
    store = Store(out_dir, experiment, chosen.measures, overwrite)
    n_failed = _run(trials, store)
    results = store.results(trials)
    text = _text(experiment, chosen, results, notes)
    _write(out_dir / f"{experiment}.txt", text)
    _write(out_dir / f"{experiment}.json", _json(experiment, chosen, results, notes))
    click.echo(text, nl=False)
    if wants_plots:
        _draw(chosen, results, out_dir)
    return int(n_failed > 0)


def _notes(chosen: Experiment, request: Request, n_frames: int | None) -> list[str]:
    """Return the lines above the tables: seeds, --most-frames, --quick, and the experiment's own notes."""
    seeds = f"{request.n_seeds} seed{'s' if request.n_seeds > 1 else ''}"
    cut = f", at most {n_frames} frames of each take" if n_frames else ""
    frames = f", the first {chosen.quick_frames} frames of each take" if chosen.quick_frames else ""
    quick = f", quick: fewer losses{frames}" if request.quick else ""
    return [f"{seeds}{cut}{quick}", *chosen.notes(request)]


def _run(trials: Sequence[Trial], store: Store) -> int:
    """Run the trials that are not finished; return the number that failed. Each message is printed once."""
    printed: set[str] = set()
    n_failed = 0
    with tqdm(total=len(trials), initial=sum(trial in store for trial in trials), unit="trial", disable=None) as bar:
        for trial in trials:
            if trial in store:
                continue
            bar.set_postfix_str(f"{trial.take} {trial.entry.method}")
            try:
                result = trial.run()
            except MocapcleanError as error:
                n_failed += 1
                message = f"{trial.take}, {trial.entry.method}: {error}"
                if message not in printed:
                    printed.add(message)
                    with tqdm.external_write_mode():
                        complain(message)
            else:
                store.add(trial, result)
            bar.update()
    return n_failed


def _capture(path: Path, options: ReadOptions) -> Capture:
    """Return a file with the options that its format takes."""
    return Capture(path=path, options=formats.declaration(path).applicable(options))


def _folder(folder: Path, options: ReadOptions) -> list[Capture]:
    """Return all takes of a folder, sorted by name; raise UsageError if there is none."""
    if not folder.is_dir():
        raise UsageError(f"--folder must be a folder. Got {folder}.")
    captures = [_capture(path, options) for path in sorted(folder.iterdir()) if formats.is_take(path)]
    if not captures:
        raise UsageError(f"{folder}: the folder must hold takes ({', '.join(formats.suffixes())}). Got none.")
    return captures


def _captures(
    files: tuple[Path, ...], in_folder: Sequence[Capture], chosen: Experiment, options: ReadOptions
) -> list[Capture]:
    """Return the named takes; without names, the paper's takes in the folder, or all takes if it has none of them."""
    if files:
        captures = [_named(path, in_folder, options) for path in files]
    else:
        captures = [capture for capture in in_folder if capture.name in chosen.sequences] or [*in_folder]
    if not captures and chosen.needs_captures:
        raise UsageError("the experiment needs takes. Name files, or give a --folder.")
    names = [capture.name for capture in captures]
    for name in names:
        if names.count(name) > 1:
            raise UsageError(
                f"{name}: the takes of a run must have different names. Got this name {names.count(name)} times."
            )
    return captures


def _shortened(captures: Sequence[Capture], n_frames: int | None) -> tuple[Capture, ...]:
    """Return the captures, with only their first frames if a number is given."""
    return tuple(capture.shortened(n_frames) if n_frames else capture for capture in captures)


def _masks(
    files: tuple[Path, ...], in_folder: Sequence[Capture], chosen: Experiment, options: ReadOptions
) -> tuple[Capture, ...]:
    """Return the named captures with natural gaps; without names, those of the experiment in the folder."""
    named = [_named(path, in_folder, options) for path in files]
    return tuple(named or [capture for capture in in_folder if capture.name in chosen.gappy])


def _named(path: Path, in_folder: Sequence[Capture], options: ReadOptions) -> Capture:
    """Return a file, or the take of this name in the folder, with or without its suffix."""
    if path.is_file():
        return _capture(path, options)
    for capture in in_folder:
        if str(path) in (capture.name, capture.path.name):
            return capture
    raise UsageError(f"{path}: a take must be a file, or the name of a file in --folder. No such file.")


def _changes(assignments: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the parameters of --set by method; raise UsageError for a malformed assignment."""
    changes: dict[str, dict[str, Any]] = {}
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        section, method, key = (*name.split("."), "", "", "")[:3]
        if not (equals and section == "methods" and method and key):
            raise UsageError(f"--set must be methods.METHOD.PARAMETER=value. Got {assignment!r}.")
        changes.setdefault(method, {})[key] = scalar(text)
    return changes


def _text(name: str, chosen: Experiment, results: Results, notes: Sequence[str]) -> str:
    """Return the text for the terminal: notes, tables, and the paper's statements."""
    lines = [f"{name}: {chosen.reference}", *notes]
    for each in chosen.tables(results):
        lines += ["", each.title, *table(each.rows, each.header)]
    in_paper = statements(name)
    if in_paper:
        lines += ["", "Statements of the paper:", *(f"  - {statement}" for statement in in_paper)]
    return "\n".join(lines) + "\n"


def _json(name: str, chosen: Experiment, results: Results, notes: Sequence[str]) -> str:
    """Return notes, rows and tables as JSON."""
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
    content = {"experiment": name, "reference": chosen.reference, "notes": list(notes), "rows": rows, "tables": tables}
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def _write(path: Path, text: str) -> None:
    with new_file(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def _draw(chosen: Experiment, results: Results, folder: Path) -> None:
    """Draw the figures and print their paths."""
    if not plots.can_draw():
        complain("no figures: matplotlib is not installed. Run pip install '.[plots]' in the clone, or use --no-plots.")
        return
    for figure in chosen.figures(results):
        for path in plots.draw(figure, folder):
            click.echo(path)
