"""Results on the disk: one line of CSV per finished trial, written at once, so that an interruption loses none."""

import csv
import hashlib
import io
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.errors import UsageError
from mocapclean.experiments.results import Results, Row
from mocapclean.experiments.trials import Trial, TrialResult
from mocapclean.files import new_file

KEY_COLUMNS = ("take", "source", "method", "variant", "parameters", "cell", "seed")


class Store:
    """The rows of one experiment in ``folder/name.csv``, and their series in ``folder/name/``.

    ``Trial.key`` identifies a row. Raises UsageError if the file has other columns or the folder cannot be made.
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
                self.path.write_text(_line([*KEY_COLUMNS, *self.measures, "series"]), encoding="utf-8", newline="\n")
        except OSError as error:
            raise UsageError(f"{self.path}: the results cannot be written: {error.strerror}.") from None

    def _load(self) -> None:
        """Read the rows; cut off a last line that an interruption has torn."""
        text = self.path.read_text(encoding="utf-8")
        complete = text[: text.rfind("\n") + 1]
        if complete != text:
            self.path.write_text(complete, encoding="utf-8", newline="\n")
        reader = csv.DictReader(io.StringIO(complete))
        if tuple(reader.fieldnames or ()) != (*KEY_COLUMNS, *self.measures, "series"):
            raise UsageError(f"{self.path}: the results are of another version. Use --overwrite to start anew.")
        for row in reader:
            self.rows[tuple(row[name] for name in KEY_COLUMNS)] = row

    def __contains__(self, trial: Trial) -> bool:
        return trial.key in self.rows

    def add(self, trial: Trial, result: TrialResult) -> None:
        """Write the result of a trial, its series first."""
        measures, series = result
        name = ""
        if series:
            name = hashlib.sha256("\n".join(trial.key).encode()).hexdigest()[:16] + ".csv"
            with new_file(self.curves / name) as part:
                _write_series(part, dict(series))
        values = {key: format(value, ".9g") for key, value in measures.items()}
        row = dict(zip(KEY_COLUMNS, trial.key, strict=True)) | {key: values.get(key, "") for key in self.measures}
        row["series"] = name
        try:
            with self.path.open("a", encoding="utf-8", newline="\n") as file:
                file.write(_line(list(row.values())))
        except OSError as error:
            raise UsageError(f"{self.path}: the results cannot be written: {error.strerror}.") from None
        self.rows[trial.key] = row

    def results(self, trials: Sequence[Trial]) -> Results:
        """Return the rows of the finished ones among some trials."""
        return Results(tuple(self._row(trial) for trial in trials if trial in self))

    def _row(self, trial: Trial) -> Row:
        """Return the row of a finished trial."""
        row = self.rows[trial.key]
        return Row(
            take=trial.take,
            method=trial.entry.method,
            variant=trial.entry.variant,
            parameters=trial.entry.parameters,
            cell=trial.cell,
            seed=trial.seed,
            values={name: float(row[name]) for name in self.measures if row[name]},
            series=partial(_read_series, self.curves / row["series"] if row["series"] else None),
        )


def _line(values: Sequence[str]) -> str:
    """Return a line of CSV."""
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
