"""The results printed in the papers, as CSV files; the first line of each file is its reference."""

import csv
from pathlib import Path


def published(name: str) -> list[dict[str, str]]:
    """Return the rows of ``name.csv``; lines that begin with # are comments."""
    text = (Path(__file__).parent / f"{name}.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def statements(experiment: str) -> list[str]:
    """Return the paper's statements about results that it only plots, in our words."""
    return [row["statement"] for row in published("statements") if row["experiment"] == experiment]
