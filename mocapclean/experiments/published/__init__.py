"""What the papers print, as data, each file with its reference in its first line."""

import csv
from pathlib import Path


def published(name: str) -> list[dict[str, str]]:
    """The rows of ``name.csv``; lines that begin with # are remarks."""
    text = (Path(__file__).parent / f"{name}.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def statements(experiment: str) -> list[str]:
    """What the paper says of results that it shows as pictures only, in our words."""
    return [row["statement"] for row in published("statements") if row["experiment"] == experiment]
