"""Figures of takes: written in every format, and true to the take."""

import re

import numpy as np
import pytest
from commands import run
from conftest import SAMPLES

import mocapclean
from mocapclean.errors import UsageError
from mocapclean.report import figures, notebook

pytest.importorskip("matplotlib", reason="matplotlib is not installed (extra plots)")

MAGIC = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}


@pytest.fixture(scope="module")
def take():
    whole = mocapclean.read(SAMPLES / "walk.c3d")
    return mocapclean.detect(whole.crop(0, 200))


@pytest.mark.parametrize("suffix", figures.SUFFIXES)
def test_a_map_is_written_in_every_format(tmp_path, suffix):
    code, _, error = run("plot", SAMPLES / "walk.c3d", SAMPLES / "walk.bvh", "-o", tmp_path / f"map{suffix}")
    assert code == 0, error
    assert (tmp_path / f"map{suffix}").read_bytes().startswith(MAGIC[suffix])


@pytest.mark.parametrize("option", [["--marker", "STRN", "--frames", "100:240"], ["--bones"]])
def test_curves_and_bones_are_drawn_of_a_filled_take(tmp_path, option):
    code, _, error = run("plot", SAMPLES / "walk.c3d", "-o", tmp_path / "one.png", "--method", "spline", *option)
    assert code == 0, error
    assert (tmp_path / "one.png").stat().st_size > 10_000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.png"]


@pytest.mark.parametrize(
    "arguments",
    [
        ["-o", "one.jpg"],
        ["-o", "one.png", "--marker", "NOBODY"],
        ["-o", "one.png", "--marker", "STRN", "--bones"],
        ["-o", "one.png", "--frames", "9:2"],
    ],
)
def test_what_cannot_be_drawn_is_refused(tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    code, _, error = run("plot", SAMPLES / "walk.c3d", "--method", "linear", *arguments)
    assert code == 2
    assert error
    assert not list(tmp_path.iterdir())


def test_a_notebook_shows_the_gaps_of_a_take(take):
    html = take._repr_html_()
    areas = re.findall(r"<title>(.*?): missing</title>", html)
    columns, gaps = np.nonzero(np.diff(np.pad(~take.trusted, ((1, 0), (0, 0))).astype(int), axis=0).T == 1)
    assert len(areas) == len(gaps)
    assert areas == [take.markers[column] for column in columns]
    assert f"{int((~take.trusted).sum()):,} samples not trusted" in html


def test_a_gap_is_filled_for_its_figure_alone(take):
    figure = take.plot_gap("C7", 80)
    lines = {line.get_label(): line for line in figure.axes[2].get_lines()}
    gap = ~take.trusted[:, take.markers.index("C7")]
    drawn = np.isfinite(np.asarray(lines["filled"].get_ydata(), dtype=float))
    assert drawn.sum() >= gap[40:160].sum() > 0
    assert not take.filled.any()
    assert len(figure.axes[0].collections) == 1  # the band
    with pytest.raises(UsageError):
        take.plot_gap("NOBODY", 80)
    with pytest.raises(UsageError):
        take.plot_gap("C7", 10_000)


def test_a_filled_take_shows_what_was_filled(take):
    filled = mocapclean.fill(take, "spline").take
    view = notebook.view_of(filled)
    assert np.array_equal(view.in_output, filled.trusted | filled.filled)
    assert not view.in_file[filled.filled].any()
    assert len(filled.plot().axes) == 1


def test_names_are_no_mathematics_and_no_markup(take):
    from dataclasses import replace

    odd = replace(take, markers=("<b>$x^{$</b>", *take.markers[1:]))
    figure = figures.sheet([notebook.view_of(odd)], ["$\\frac{$"])
    figure.canvas.draw()
    trusted = odd.trusted.copy()
    trusted[:5, 0] = False
    assert "&lt;b&gt;" in replace(odd, trusted=trusted)._repr_html_()
