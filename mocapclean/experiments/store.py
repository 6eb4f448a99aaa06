"""Rows that survive an interruption: a line of CSV for every finished job, written when it is finished."""

import csv
import hashlib
import io
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.errors import UsageError
from mocapclean.experiments.jobs import Found, Job
from mocapclean.experiments.results import Results, Row
from mocapclean.files import new_file

KEY = ("take", "source", "method", "variant", "parameters", "cell", "seed")


class Store:
    """The rows of one experiment in ``folder/name.csv``, and their series (curves over frames) in ``folder/name/``.

    A job is known by its key: a capture's name and hash, method, variant, changed parameters, cell and seed. Raises
    UsageError where the file holds other columns, or the folder cannot be made.
    """

    def __init__(self, folder: Path, name: str, measures: Sequence[str], overwrite: bool = False) -> None:
        self.path, self.curves = folder / f"{name}.csv", folder / name
        self.measures = tuple(measures)
        self.rows: dict[tuple[str, ...], dict[str, str]] = {}
        try:
            self.curves.mkdir(parents=True, exist_ok=True)
            if overwrite:
                self.path.unlink(missing_ok=True)
                for old in self.curves.glob("*.csv"):
                    old.unlink()
            if self.path.exists():
                self._load()
            else:
                self.path.write_text(_line([*KEY, *self.measures, "series"]), encoding="utf-8")
        except OSError as fault:
            raise UsageError(f"{self.path}: the results cannot be kept: {fault.strerror}.") from None

    def _load(self) -> None:
        """Read the rows; a last line that an interruption has torn is cut off."""
        text = self.path.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            self.path.write_text(whole, encoding="utf-8")
        reader = csv.DictReader(io.StringIO(whole))
        if tuple(reader.fieldnames or ()) != (*KEY, *self.measures, "series"):
            raise UsageError(f"{self.path}: the results are of another version. Use --overwrite to start anew.")
        for row in reader:
            self.rows[tuple(row[name] for name in KEY)] = row

    def __contains__(self, job: Job) -> bool:
        return job.key in self.rows

    def add(self, job: Job, found: Found) -> None:
        """Write what a job found, its series first."""
        measures, series = found
        name = ""
        if series:
            name = hashlib.sha256("\n".join(job.key).encode()).hexdigest()[:16] + ".csv"
            with new_file(self.curves / name) as part:
                _write_series(part, dict(series))
        values = {key: format(value, ".9g") for key, value in measures.items()}
        row = dict(zip(KEY, job.key, strict=True)) | {key: values.get(key, "") for key in self.measures}
        row["series"] = name
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(_line(list(row.values())))
        except OSError as fault:
            raise UsageError(f"{self.path}: the results cannot be kept: {fault.strerror}.") from None
        self.rows[job.key] = row

    def results(self, jobs: Sequence[Job]) -> Results:
        """The rows of those jobs that are finished."""
        return Results(tuple(self._row(job) for job in jobs if job in self))

    def _row(self, job: Job) -> Row:
        row = self.rows[job.key]
        return Row(
            take=job.take,
            method=job.entry.method,
            variant=job.entry.variant,
            parameters=job.entry.parameters,
            cell=job.cell,
            seed=job.seed,
            values={name: float(row[name]) for name in self.measures if row[name]},
            series=partial(_read_series, self.curves / row["series"] if row["series"] else None),
        )


def _line(values: Sequence[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(values)
    return text.getvalue()


def _write_series(path: Path, series: dict[str, Floats]) -> None:
    table = np.column_stack(list(series.values()))
    np.savetxt(path, table, fmt="%.6g", delimiter=",", header=_line(list(series)).rstrip("\n"), comments="")


def _read_series(path: Path | None) -> dict[str, Floats]:
    if path is None or not path.exists():
        return {}
    with path.open(encoding="utf-8") as file:
        names = next(csv.reader([file.readline()]))
        table = np.loadtxt(file, delimiter=",", ndmin=2)
    return {name: table[:, k] for k, name in enumerate(names)}
