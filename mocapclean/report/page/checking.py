"""The page of a check: each verdict with what an inspection of its take shows."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mocapclean.errors import MocapcleanError
from mocapclean.pipeline.outcome import Verdict
from mocapclean.pipeline.view import View
from mocapclean.report import record
from mocapclean.report.page.data import write_take


@dataclass(frozen=True)
class KeepChecked:
    """What a worker does with a checked take: write its data for the page. files: where, by source."""

    files: Mapping[Path, Path]

    def __call__(self, verdict: Verdict, view: View | None) -> None:
        """Write the data of a take that could be read; one that cannot be written has none in the page."""
        if view is not None:
            try:
                write_take(self.files[verdict.source], checked_row(verdict), view)
            except MocapcleanError:
                return


def checked_row(verdict: Verdict) -> dict[str, Any]:
    """Return the row of a verdict, with the counts, gaps and bones of an inspected take where there are such."""
    inspected = {} if verdict.inspected is None else record.row(verdict.inspected)
    return {**inspected, **record.verdict_row(verdict), "status": "passed" if verdict.passes else "failed the check"}
