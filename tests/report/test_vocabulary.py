"""One vocabulary: every status has a kind, and page and figures have its colours."""

import re
from pathlib import Path

import mocapclean
from mocapclean.report.vocabulary import KINDS, kind_of, statuses
from mocapclean.take.status import Status

PAGE = Path(mocapclean.__file__).parent / "report" / "page"
DOCUMENT = Path(mocapclean.__file__).parents[1] / "docs" / "page.md"


def luminance(colour):
    """Relative luminance of an sRGB colour (WCAG 2.2)."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_every_status_has_a_kind():
    names = {kind.name for kind in KINDS}
    assert {kind_of(status) for status in Status} == names
    assert [each["code"] for each in statuses()] == [status.code for status in Status]


def test_kinds_differ_without_colour():
    looks = [(kind.shape, kind.hatch) for kind in KINDS]
    assert len(set(looks)) == len(looks)
    assert len({kind.severity for kind in KINDS}) == len(KINDS)


def test_the_style_has_the_colours_of_the_kinds():
    style = (PAGE / "page.css").read_text(encoding="utf-8")
    light, dark = re.findall(r":root(?:\[.*?\])? \{(.*?)\}", style, re.DOTALL)[:2]
    for kind in KINDS:
        assert f"--{kind.name}: {kind.colour};" in light
        (found,) = re.findall(rf"--{kind.name}: (#\w+);", dark)
        assert luminance(found) > 0.25, f"{kind.name} is too dark on a dark page"
        assert f".chip.{kind.name} i" in style


def test_the_document_lists_the_kinds():
    rows = re.findall(
        r"^\| (\w+) \| `(#\w+)` \| .*? \| .*? \| (.*) \|$", DOCUMENT.read_text(encoding="utf-8"), re.MULTILINE
    )
    expected = [
        (kind.name, kind.colour, ", ".join(f"`{status.code}`" for status in Status if kind_of(status) == kind.name))
        for kind in KINDS
    ]
    assert rows == expected


def test_the_band_of_the_page_is_that_of_the_report():
    from mocapclean.evaluation.metrics import INTERVAL_90

    script = (PAGE / "scripts" / "curves.js").read_text(encoding="utf-8")
    assert f"const BAND = {INTERVAL_90};" in script


def test_every_rule_is_explained():
    from mocapclean.detection import RULES

    script = (PAGE / "scripts" / "text.js").read_text(encoding="utf-8")
    section = script.split("export const RULES")[1].split("};")[0]
    assert set(re.findall(r"^  (\w+):", section, re.MULTILINE)) == {*RULES, "user"}
