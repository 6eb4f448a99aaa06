"""Annotations and summaries of a check: whatever a name or a message holds, GitHub shows it and nothing more."""

import re
from pathlib import Path
from urllib.parse import unquote

from hypothesis import given
from hypothesis import strategies as st

from mocapclean.pipeline.outcome import Breach, Verdict
from mocapclean.report.ci import MOST_ROWS, annotations, markdown

TEXTS = st.text(min_size=1, max_size=40)
COMMAND = re.compile(r"::(?P<name>\w+) (?P<properties>[^:]*)::(?P<data>.*)", re.DOTALL)


def failing(name="a.c3d", message="too long", limit="longest_gap"):
    breach = Breach(limit=limit, message=message, advice="fill it")
    return Verdict(source=Path(name), breaches=(breach,))


@given(TEXTS.filter(lambda text: "\0" not in text), TEXTS)
def test_an_annotation_is_one_line_that_github_reads_back(name, message):
    verdict = failing(name, message)
    (line,) = annotations([verdict])
    assert "\n" not in line
    assert "\r" not in line
    found = COMMAND.fullmatch(line)
    properties = dict(part.split("=", 1) for part in found["properties"].split(","))
    assert set(properties) == {"file", "title"}
    assert found["name"] == "error"
    # GitHub's runner puts back %25, %0D, %0A, and in properties also %3A and %2C.
    assert unquote(properties["file"]) == unquote(str(verdict.source).replace("%", "%25"))
    assert unquote(found["data"]) == unquote(f"{message}; fill it".replace("%", "%25"))


def test_escapes_are_those_that_github_documents():
    (line,) = annotations([failing("50%,a:b\r\n.c3d", "1 % off:\r\na, b")])
    assert line == "::error file=50%25%2Ca%3Ab%0D%0A.c3d,title=mocapclean check::1 %25 off:%0D%0Aa, b; fill it"


def test_only_failing_takes_are_annotated():
    assert list(annotations([Verdict(source=Path("fine.c3d"))])) == []


@given(TEXTS.filter(lambda text: "\0" not in text), TEXTS)
def test_a_row_of_the_summary_stays_one_row_without_markup(name, message):
    text = markdown([failing(name, message), failing("next.c3d")], "Limits of the configuration.")
    lines = text.split("\n")
    rows = lines[lines.index("|---|---|---|") + 1 :]
    assert len(rows) == 3
    assert rows[-1] == ""
    cells = re.split(r"(?<!\\)(?:\\\\)*\|", rows[0])
    assert len(cells) == 5
    plain = re.sub(r"\\[\\`*_{}\[\]()#+\-.!|~]|&lt;|&amp;|<br>", "", rows[0])
    assert not re.search(r"[<`*_\[\]~]", plain)


def test_the_summary_has_the_totals_and_the_limits_and_ends():
    verdicts = [failing(f"{k}.c3d") for k in range(MOST_ROWS + 3)] + [Verdict(source=Path("fine.c3d"))]
    text = markdown(verdicts, "Limits of the preset film.")
    assert text.startswith(f"## mocapclean check: 1 of {MOST_ROWS + 4} takes pass\n\nLimits of the preset film.\n")
    assert text.endswith("\n3 more takes fail.\n")
    assert "fine" not in text
    assert markdown([Verdict(source=Path("fine.c3d"))], "x").count("\n") == 4
