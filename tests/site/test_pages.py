"""The tutorial prints what the commands print, and every picture of the documents is made by a command."""

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"


@pytest.fixture
def benchmark(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return importlib.import_module


def test_the_tutorial_shows_what_its_commands_print(benchmark):
    pages = benchmark("pages")
    text = (DOCS / "tutorial.md").read_text(encoding="utf-8")
    assert text.count("\n$ mocapclean ") >= 5
    assert pages.without_durations(pages.ran(text)) == pages.without_durations(text), (
        "run: python benchmarks/pages.py docs/tutorial.md"
    )


def test_the_output_of_a_command_replaces_what_the_page_had(benchmark):
    page = "```console\n$ mocapclean inspect nothing.c3d\nBEFORE\n$ echo $?\nBEFORE\n```"
    ran = benchmark("pages").ran(page)
    assert "BEFORE" not in ran
    assert ran.splitlines()[-2] in ("1", "2")
    with pytest.raises(ValueError, match="rm"):
        benchmark("pages").ran("```console\n$ rm walk.c3d\n```")


def test_every_picture_is_made_by_a_command_and_is_in_the_gallery(benchmark):
    pytest.importorskip("PIL", reason="pillow is not installed (extra plots)")
    pytest.importorskip("playwright", reason="playwright is not installed (extra test)")
    gallery = benchmark("gallery")
    made = {*gallery.PLOTS, *gallery.SCREENSHOTS}
    assert {path.stem for path in (DOCS / "images").iterdir()} == made
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\]\(images/(\w+)\.png\)", text)) == made
    for command in gallery.PLOTS.values():
        assert f"\n    mocapclean {command}\n" in text


def test_every_picture_has_a_text_for_those_who_cannot_see_it():
    for path in DOCS.rglob("*.md"):
        for text in re.findall(r"!\[(.*?)\]\(", path.read_text(encoding="utf-8")):
            assert len(text.split()) >= 4, f"{path.name}: {text!r}"
