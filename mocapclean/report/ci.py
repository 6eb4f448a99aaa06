"""Verdicts for the pages of a CI service: annotations of GitHub Actions, and a summary in Markdown."""

from collections.abc import Iterator, Sequence

from mocapclean.errors import printable
from mocapclean.pipeline.outcome import Verdict

MOST_ROWS = 500
"""Most takes in a summary, chosen by hand: GitHub takes at most 1 MiB for each step."""
_DATA = str.maketrans({"%": "%25", "\r": "%0D", "\n": "%0A"})
_PROPERTY = str.maketrans({"%": "%25", "\r": "%0D", "\n": "%0A", ":": "%3A", ",": "%2C"})
_MARKDOWN = {character: f"\\{character}" for character in "\\`*_{}[]()#+-.!|~"} | {"<": "&lt;", "&": "&amp;"}


def annotations(verdicts: Sequence[Verdict]) -> Iterator[str]:
    """Yield a line for each take that fails, which GitHub Actions shows beside its file.

    Source: "Workflow commands for GitHub Actions" (docs.github.com); the escapes are those of its toolkit.
    """
    for verdict in verdicts:
        if not verdict.passes:
            file = str(verdict.source).translate(_PROPERTY)
            text = "\n".join(f"{breach.message}; {breach.advice}" for breach in verdict.breaches)
            yield f"::error file={file},title=mocapclean check::{text.translate(_DATA)}"


def markdown(verdicts: Sequence[Verdict], limits: str) -> str:
    """Return a summary: how many takes pass, and a table of those that fail. limits: the words for their source."""
    failed = [verdict for verdict in verdicts if not verdict.passes]
    lines = [f"## mocapclean check: {len(verdicts) - len(failed)} of {len(verdicts)} takes pass", "", limits, ""]
    if failed:
        lines += ["| take | limits | what is wrong |", "|---|---|---|"]
    for verdict in failed[:MOST_ROWS]:
        names = ", ".join(breach.limit for breach, _ in verdict.worst)
        texts = "<br>".join(_cell(breach.message) for breach, _ in verdict.worst)
        lines.append(f"| {_cell(str(verdict.source))} | {_cell(names)} | {texts} |")
    if len(failed) > MOST_ROWS:
        lines += ["", f"{len(failed) - MOST_ROWS:,} more takes fail."]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    """Return a text as Markdown shows it literally, on one line."""
    return "".join(_MARKDOWN.get(character, character) for character in printable(text))
