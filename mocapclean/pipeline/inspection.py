"""Inspect one take: read it and detect; write nothing."""

import hashlib
from dataclasses import replace
from pathlib import Path

from mocapclean.config.settings import Settings
from mocapclean.pipeline.outcome import Outcome
from mocapclean.pipeline.prepare import prepare
from mocapclean.pipeline.summary import summarise


def inspect(source: Path, settings: Settings) -> Outcome:
    """Read and detect, write nothing. Raises what reading raises."""
    prepared = prepare(source, settings)
    selected = prepared.selected
    outcome = summarise(selected, selected, prepared.codes, settings)
    return replace(outcome, source=source, status="inspected", format=prepared.format, source_sha256=digest(source))


def digest(path: Path) -> str:
    """Return the SHA-256 of a file, as hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
