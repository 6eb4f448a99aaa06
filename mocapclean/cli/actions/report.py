"""The action of ``mocapclean report``: the page of a report, with pictures of the takes whose files are found."""

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from mocapclean.batch.inputs import find
from mocapclean.cli.guard import complain
from mocapclean.config.settings import Settings
from mocapclean.errors import MocapcleanError, UsageError
from mocapclean.files import check_output, make_folder
from mocapclean.pipeline.inspection import digest
from mocapclean.pipeline.rebuilding import rebuilt_view
from mocapclean.pipeline.summary import summarise
from mocapclean.pipeline.view import View
from mocapclean.report import record
from mocapclean.report.page.building import PageTake, require_library, write_page
from mocapclean.report.page.data import write_take
from mocapclean.report.page.places import MOST_EMBEDDED, data_file, data_folder, remove_data


def work(report: Path, files: tuple[Path, ...], output: Path, overwrite: bool) -> int:
    """Write the page of a report; return the exit code."""
    require_library()
    check_output(output, report, overwrite)
    content = _load(report)
    found = _Files(report, files)
    rows = content["takes"]
    for source in found.of_rows(rows):
        check_output(output, source, True)
    make_folder(data_folder(output))
    pages = [
        _page_take(row, content["config"], found, data_file(output, f"{i} {row['source']}"))
        for i, row in enumerate(rows)
    ]
    embed = len(rows) <= MOST_EMBEDDED
    write_page(output, pages, embed=embed)
    if embed:
        remove_data(output, [page.data for page in pages if page.data])
    return 0


def _load(path: Path) -> Mapping[str, Any]:
    """Return a report; raise UsageError for a file that is none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as fault:
        raise UsageError(f"{path}: a report must be JSON that mocapclean wrote. {fault}") from None
    if not isinstance(content, dict) or not isinstance(content.get("takes"), list) or "config" not in content:
        raise UsageError(f"{path}: a report must be JSON that mocapclean wrote. It has no takes.")
    if content.get("schema") != record.SCHEMA:
        message = (
            f"the report must be of schema {record.SCHEMA}. It is of {content.get('schema')}; run the command again."
        )
        raise UsageError(f"{path}: {message}")
    return content


class _Files:
    """Where the files are that a report names: in their places, beside the report, or among the given ones."""

    def __init__(self, report: Path, takes: tuple[Path, ...]) -> None:
        self.folder = report.parent
        self.given: dict[str, list[Path]] = {}
        for each in find(takes):
            self.given.setdefault(each.path.name, []).append(each.path)
        for folder in filter(Path.is_dir, takes):
            for path in folder.rglob("*.npz"):
                self.given.setdefault(path.name, []).append(path)

    def of_rows(self, rows: Iterable[Mapping[str, Any]]) -> Iterator[Path]:
        """Yield all files that a page of these rows could be written over: the given ones, and those of the report."""
        for paths in self.given.values():
            yield from paths
        for row in rows:
            for key in ("source", "output", "sidecar"):
                yield from self.places(row.get(key))

    def places(self, name: str | None) -> Iterator[Path]:
        """Yield the places where a file of the report may be, the given ones first."""
        if name:
            yield from self.given.get(Path(name).name, ())
            yield from filter(Path.is_file, (Path(name), self.folder / name, self.folder / Path(name).name))


def _page_take(row: dict[str, Any], config: Mapping[str, Any], files: _Files, data: Path) -> PageTake:
    """Return a take of the page, with its data written if its files are those of the report."""
    failed = row.get("status") in ("failed", "skipped")
    view = None if failed else _view(row, config, files)
    if view is not None and "passes" in row:
        inspected = record.row(summarise(view.before, view.before, view.codes, Settings()))
        row = {**inspected, **row, "status": "passed" if row["passes"] else "failed the check"}
    if failed:
        return PageTake(row=row, data=None)
    write_take(data, row, view)
    return PageTake(row=row, data=data)


def _view(row: Mapping[str, Any], config: Mapping[str, Any], files: _Files) -> View | None:
    """Return the view of a row, or None, with a message, where its files are not found."""
    hashes = row.get("sha256", {})
    source = _same(files.places(row["source"]), hashes.get("source"))
    output = _same(files.places(row.get("output")), hashes.get("output"))
    if source is None or (row.get("output") and output is None):
        missing = row["source"] if source is None else row["output"]
        complain(
            f"{missing}: not found with the report's hash; the take has no pictures. Name its folder after the report."
        )
        return None
    try:
        return rebuilt_view(row, config, source, output, next(files.places(row.get("sidecar")), None))
    except MocapcleanError as error:
        complain(f"{row['source']}: the take has no pictures: {error}")
        return None


def _same(places: Iterator[Path], sha256: str | None) -> Path | None:
    """Return the first file with a hash, or the first of all where the report has none."""
    return next((path for path in places if not sha256 or digest(path) == sha256), None)
