"""The page in a real browser: it shows what the report and the files hold, and works from a file without a network."""

import json
import re

import numpy as np
import pytest
from browser import Visit, browsing
from commands import run
from conftest import SAMPLES
from small_takes import store

pytest.importorskip("bokeh", reason="bokeh is not installed (extra html)")
pytest.importorskip("jinja2", reason="jinja2 is not installed (extra html)")

NASTY = "<script>document.title='x'</script>&quot;" + "n" * 460
MANY = [f"{session}/take{number:02d}.c3d" for session in ("monday", "tuesday") for number in range(9)]


@pytest.fixture(scope="module")
def browser():
    with browsing() as one:
        yield one


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """The sample take, repaired with a page, a sidecar and a report."""
    folder = tmp_path_factory.mktemp("walk")
    arguments = ["--reference", SAMPLES / "walk_truth.c3d", "--no-self-check", "--sidecar", folder / "walk.npz"]
    code, _, error = run(
        "fill", SAMPLES / "walk.c3d", "-o", folder / "walk.c3d", "--html", folder / "walk.html", *arguments
    )
    assert code == 0, error
    return folder


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """Eighteen small takes in two folders, with their page."""
    folder = tmp_path_factory.mktemp("many")
    store(folder / "in", *MANY)
    (folder / "in" / "broken.c3d").write_bytes(b"no capture")
    code, _, _ = run(
        "fill", folder / "in", "--out-dir", folder / "out", "--method", "spline", "--html", folder / "all.html"
    )
    assert code == 1
    return folder


@pytest.fixture(scope="module")
def joints(tmp_path_factory):
    """A BVH with a span to distrust, and with a joint whose name is long and looks like markup."""
    folder = tmp_path_factory.mktemp("joints")
    text = (SAMPLES / "walk.bvh").read_text()
    name = re.findall(r"JOINT (\S+)", text)[3]
    (folder / "walk.bvh").write_text(re.sub(rf"JOINT {name}\b", lambda _: f"JOINT {NASTY}", text))
    (folder / "bad.csv").write_text(f'marker,first,last\n"{NASTY}",100,120\n')
    arguments = ["--gaps", folder / "bad.csv", "--method", "spline", "--html", folder / "page.html"]
    code, _, error = run("fill", folder / "walk.bvh", *arguments)
    assert code == 0, error
    return folder


def test_the_page_needs_no_network_and_reports_no_error(browser, walk):
    with Visit(browser, walk / "walk.html") as visit:
        assert not visit.errors
        assert all(url.startswith(("file:", "data:", "blob:")) for url in visit.requests)
        assert visit.text("h1 #take-name") == "walk.c3d"
    assert not re.search(
        r'(?:src|href)="https?:', (walk / "walk.html").read_text(encoding="utf-8").split("<script>")[0]
    )


def test_the_samples_of_the_page_are_those_of_the_files(browser, walk):
    with np.load(walk / "walk.npz") as arrays:
        positions, status, sd = arrays["positions"], arrays["status"], arrays["sd"]
    with Visit(browser, walk / "walk.html") as visit:
        found = visit.page.evaluate(
            """() => {
                const samples = mocapclean.view().samples;
                return [[...samples.after], [...samples.codes], [...samples.sd].map(v => isNaN(v) ? -1 : v)];
            }"""
        )
    n_frames, n_markers = status.shape
    shown = np.array(found[0]).reshape(n_markers, 3, n_frames).transpose(2, 0, 1)
    known = np.isfinite(positions).all(axis=2)
    assert known.all()
    assert np.abs(shown - positions).max() < 0.0051 + 1e-3  # half a step, and the rounding of 32-bit floats
    assert np.array_equal(np.array(found[1]).reshape(n_markers, n_frames).T, status)
    bars = np.array(found[2]).reshape(n_markers, n_frames).T
    assert np.array_equal(bars >= 0, ~np.isnan(sd))
    assert np.abs(bars - sd)[~np.isnan(sd)].max() < 0.0051


def test_a_click_on_a_gap_shows_its_curve_with_the_values_of_the_report(browser, walk):
    row = json.loads((walk / "walk.c3d.report.json").read_text())["takes"][0]
    gap = max((gap for gap in row["gaps"] if gap["first"] > 100), key=lambda gap: gap["length"])
    with np.load(walk / "walk.npz") as arrays:
        column = arrays["markers"].tolist().index(gap["marker"])
        middle = (gap["first"] + gap["last"]) // 2
        after = arrays["positions"][middle - row["first_frame"], column]
    with Visit(browser, walk / "walk.html") as visit:
        x, y = visit.page.evaluate(
            """([marker, frame]) => {
                const view = mocapclean.view(), map = view.map, place = document.getElementById("map");
                const row = map.rows().length - 1 - map.rows().indexOf(view.samples.markers.indexOf(marker));
                const top = map.chart.view.frame.y_scale.compute(row);
                place.scrollTop = top - 100;
                const box = map.chart.view.el.getBoundingClientRect();
                return [box.left + map.chart.x(frame), box.top + top];
            }""",
            [gap["marker"], middle],
        )
        visit.page.mouse.click(x, y)
        visit.page.wait_for_function(
            "name => document.getElementById('marker-name').textContent == name", arg=gap["marker"]
        )
        visit.page.wait_for_function("() => mocapclean.view().curves.views?.[0]?.frame")
        visit.page.evaluate("frame => mocapclean.view().show(frame)", middle - row["first_frame"])
        story = visit.text("#story")
        assert f"frames {gap['first']}–{gap['last']} ({gap['length']} frames" in story
        assert f"expected 3D error {gap['expected_3d']:.2f} mm ({gap['grade']})" in story
        assert f"error against the reference {gap['error']['rmse_3d']:.2f} mm" in story
        cells = visit.page.eval_on_selector_all(
            "#reading td:last-child", "cells => cells.map(cell => cell.textContent)"
        )
        assert np.abs([float(cell.removesuffix(" mm")) for cell in cells] - after).max() < 0.0101
        drawn = visit.page.evaluate(
            """() => mocapclean.view().curves.charts.map(({ parts }) =>
                [parts.filled.data.y, parts.band.data.low].map(values => values.filter(y => !isNaN(y)).length))"""
        )
        assert all(filled >= gap["length"] and band >= gap["length"] for filled, band in drawn)
        assert not visit.errors


def test_curves_keep_every_extreme_at_any_zoom(browser, walk):
    with Visit(browser, walk / "walk.html") as visit:
        same = visit.page.evaluate(
            """() => {
                const view = mocapclean.view(), curves = view.curves;
                curves.x.setv({ start: 1, end: 480 });
                curves.place.style.width = "230px";
                curves.update();
                const least = values => Math.min(...values), largest = values => Math.max(...values);
                return curves.charts.map(({ curve, parts }) => {
                    const known = values => values.filter(v => !isNaN(v));
                    const all = known([...Array(480).keys()].map(curve.after));
                    const shown = known([...parts.after.data.y, ...parts.filled.data.y]);
                    const is_whole = least(all) == least(shown) && largest(all) == largest(shown);
                    return [is_whole, shown.length < 2.2 * all.length];
                });
            }"""
        )
    assert same == [[True, True]] * 3


def test_the_body_plays_and_is_seen_before_and_after(browser, walk):
    with Visit(browser, walk / "walk.html") as visit:
        visit.page.evaluate("mocapclean.view().show(0)")
        drawn = "() => mocapclean.view().player.drawn"
        before = visit.page.evaluate(drawn)
        visit.page.click("#play")
        visit.page.wait_for_function(f"before => ({drawn})() > before + 10", arg=before)
        visit.page.click("#play")
        assert visit.page.evaluate("mocapclean.view().frame") > 0
        assert visit.text("#play") == "Play"
        n_after = visit.page.evaluate(
            "mocapclean.view().show(20), mocapclean.view().player.sources.points.data.x.length"
        )
        visit.page.keyboard.press("b")
        n_before = visit.page.evaluate("mocapclean.view().player.sources.points.data.x.length")
        assert n_before < n_after == 41
        yaw = visit.page.evaluate("mocapclean.view().player.yaw")
        visit.page.locator("#player").scroll_into_view_if_needed()
        box = visit.page.locator("#player").bounding_box()
        visit.page.mouse.move(box["x"] + 100, box["y"] + 100)
        visit.page.mouse.down()
        visit.page.mouse.move(box["x"] + 160, box["y"] + 100)
        visit.page.mouse.up()
        assert visit.page.evaluate("mocapclean.view().player.yaw") != yaw
        assert not visit.errors


def test_keys_step_through_frames_and_gaps(browser, walk):
    with Visit(browser, walk / "walk.html") as visit:
        visit.page.evaluate("mocapclean.view().show(10)")
        visit.page.keyboard.press("ArrowRight")
        visit.page.keyboard.press("Shift+ArrowRight")
        assert visit.text("#now").startswith("frame 22 ")
        first = visit.text("#marker-name") + visit.text("#story")
        visit.page.keyboard.press("n")
        visit.page.wait_for_function(
            """first => document.getElementById('marker-name').innerText
                + document.getElementById('story').innerText != first""",
            arg=first,
        )
        visit.page.keyboard.press("?")
        assert visit.page.is_visible("#help")


def test_a_row_of_the_lists_leads_to_its_place(browser, walk):
    row = json.loads((walk / "walk.c3d.report.json").read_text())["takes"][0]
    with Visit(browser, walk / "walk.html") as visit:
        rows = visit.page.eval_on_selector_all("#list tbody tr", "rows => rows.map(row => row.innerText)")
        assert len(rows) == len(row["gaps"])
        line = visit.page.locator("#list tbody tr").nth(7)
        marker, frames = line.locator("th").inner_text(), line.locator("td").first.inner_text()
        line.locator("button").click()
        visit.page.wait_for_function("name => document.getElementById('marker-name').textContent == name", arg=marker)
        assert visit.text("#now").startswith(f"frame {frames.split('–')[0]} ")


def test_the_overview_searches_filters_and_opens_takes(browser, many):
    assert not list((many / "all_files").glob("*.part*"))
    assert len(list((many / "all_files").glob("take-*.js"))) == len(MANY)
    with Visit(browser, many / "all.html") as visit:
        assert visit.page.locator("#takes tr").count() == len(MANY) + 1
        assert visit.page.locator("#takes tr").first.inner_text().startswith("look first")
        assert "broken.c3d" in visit.page.locator("#takes tr").first.inner_text()
        visit.page.keyboard.press("/")
        visit.page.keyboard.type("tuesday take03")
        assert visit.page.locator("#takes tr").count() == 1
        assert visit.text("#found") == "1 take found"
        visit.page.fill("#search", "")
        visit.page.locator("#filters button").nth(1).click()
        assert visit.page.locator("#takes tr").count() == 1
        visit.page.locator("#filters button").nth(0).click()
        visit.page.locator("th[data-order=name] button").click()
        names = visit.page.eval_on_selector_all("#takes .take", "links => links.map(link => link.title)")
        assert names == sorted(names, key=str.lower)
        visit.page.locator("#takes a.take", has_text="take03").first.click()
        visit.page.wait_for_function("document.body.dataset.ready")
        assert visit.text("#take-name") == "take03.c3d"
        first = visit.page.evaluate("document.body.dataset.ready")
        visit.page.keyboard.press("j")
        visit.page.wait_for_function("first => document.body.dataset.ready != first", arg=first)
        visit.page.keyboard.press("Escape")
        visit.page.wait_for_function("document.body.dataset.show == 'overview'")
        assert not visit.errors
        assert all(url.startswith("file:") or url.startswith("data:") for url in visit.requests)
        assert sum(url.endswith("bokeh.min.js") for url in visit.requests) == 1


def test_a_thousand_takes_are_searched_at_once(browser, many, tmp_path):
    report = many / "thousand.json"
    run("fill", many / "in" / "monday", "--out-dir", many / "again", "--method", "spline", "--report", report)
    content = json.loads(report.read_text())
    content["takes"] = [
        {**content["takes"][i % 9], "source": f"gone/take{i:04d}.c3d", "output": None} for i in range(1000)
    ]
    report.write_text(json.dumps(content))
    code, _, _ = run("report", report, "-o", tmp_path / "page.html")
    assert code == 0
    with Visit(browser, tmp_path / "page.html") as visit:
        seconds = visit.page.evaluate(
            """() => { const start = performance.now(), field = document.getElementById("search");
                   for (const text of ["t", "take0", "take09", "take099"]) {
                       field.value = text;
                       field.dispatchEvent(new Event("input"));
                   }
                   return (performance.now() - start) / 1000; }"""
        )
        assert visit.page.locator("#takes tr").count() == 10
        assert seconds < 4  # four searches; a page that lays out all takes each time needs far longer
        visit.page.fill("#search", "")
        assert visit.page.locator("#takes tr").count() == 300
        visit.page.click("#more-takes")
        assert visit.page.locator("#takes tr").count() == 600


def test_names_stay_text(browser, joints):
    with Visit(browser, joints / "page.html") as visit:
        assert visit.page.title() == "walk.bvh"
        assert visit.page.evaluate("mocapclean.view().samples.markers").count(NASTY) == 1
        visit.page.evaluate("name => mocapclean.view().go(name, 110)", NASTY)
        visit.page.wait_for_function("name => document.getElementById('marker-name').textContent == name", arg=NASTY)
        assert visit.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        assert not visit.errors


def test_joints_have_angles_in_degrees(browser, joints):
    with Visit(browser, joints / "page.html") as visit:
        joint = visit.page.evaluate(
            "mocapclean.view().samples.channels.find(channel => channel.unit == 'degrees').joint"
        )
        visit.page.evaluate("name => mocapclean.view().go(name, 5)", joint)
        visit.page.wait_for_function("name => document.getElementById('marker-name').textContent == name", arg=joint)
        visit.page.check("#angles")
        visit.page.wait_for_function("document.getElementById('reading').innerText.includes('°')")
        assert not visit.errors


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_follows_the_theme_of_the_system_and_the_button(browser, walk, scheme):
    paper = "getComputedStyle(document.body).getPropertyValue('--paper').trim()"
    with Visit(browser, walk / "walk.html", color_scheme=scheme) as visit:
        assert visit.page.evaluate("document.documentElement.dataset.theme") == scheme
        assert (visit.page.evaluate(paper) == "#ffffff") == (scheme == "light")
        visit.page.click("#theme")
        visit.page.click("#theme")
        assert visit.page.evaluate("document.documentElement.dataset.theme") == "dark"
        assert visit.page.evaluate("mocapclean.view().map.chart.figure.background_fill_color") == visit.page.evaluate(
            paper
        )
        assert not visit.errors


@pytest.mark.parametrize("which", ["walk", "many"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_serious_fault(browser, request, which, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed (extra test)")
    folder = request.getfixturevalue(which)
    with Visit(browser, folder / {"walk": "walk.html", "many": "all.html"}[which], color_scheme=scheme) as visit:
        found = axe.Axe().run(visit.page).response["violations"]
    serious = [
        f"{fault['id']}: {fault['nodes'][0]['html'][:120]}"
        for fault in found
        if fault["impact"] in ("serious", "critical")
    ]
    assert not serious


def test_print_shows_no_controls(browser, walk):
    with Visit(browser, walk / "walk.html") as visit:
        visit.page.emulate_media(media="print")
        assert not visit.page.is_visible("#play")
        assert visit.page.is_visible("#methods")


def test_a_check_has_a_page_too(browser, many, tmp_path):
    run("check", many / "in" / "monday" / "take00.c3d", many / "in" / "broken.c3d", "--html", tmp_path / "check.html")
    with Visit(browser, tmp_path / "check.html") as visit:
        assert visit.page.locator("#takes tr").count() == 2
        assert not (tmp_path / "check_files").exists()
        visit.page.locator("#takes a.take").first.click()
        visit.page.wait_for_function("document.body.dataset.ready")
        assert "missing in the file; no method ran" in visit.text("#story")
        assert not visit.errors


def test_a_resumed_run_makes_the_page_of_all_takes(many, tmp_path):
    store(tmp_path / "in", "a.c3d", "b.c3d")
    command = ["fill", tmp_path / "in", "--out-dir", tmp_path / "out", "--method", "spline", "--resume"]
    assert run(*command, "--html", tmp_path / "page.html")[0] == 0
    files = sorted((tmp_path / "page_files").glob("take-*.js"))
    assert len(files) == 2
    first = (tmp_path / "page.html").read_text(encoding="utf-8")
    files[0].unlink()
    code, told, error = run(*command, "--html", tmp_path / "page.html")
    assert code == 0, error
    assert "1 done before" in told  # the take whose data were there
    assert files[0].exists()
    assert len((tmp_path / "page.html").read_text(encoding="utf-8")) == pytest.approx(len(first), rel=0.01)


def test_a_page_replaces_no_file_unasked(tmp_path):
    store(tmp_path, "a.c3d")
    (tmp_path / "page.html").write_text("mine")
    code, _, error = run("fill", tmp_path / "a.c3d", "--method", "spline", "--html", tmp_path / "page.html")
    assert code == 2
    assert "page.html" in error
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.c3d", "page.html"]
    code, _, error = run("check", tmp_path / "a.c3d", "--html", tmp_path / "a.c3d", "--overwrite")
    assert code == 2
    assert (tmp_path / "page.html").read_text() == "mine"


@pytest.mark.parametrize("command", ["fill", "check", "report"])
def test_a_missing_library_is_named_before_anything_is_done(tmp_path, monkeypatch, command):
    from mocapclean.report.page import building

    store(tmp_path, "a.c3d")
    (tmp_path / "report.json").write_text("{}")
    monkeypatch.setattr(building.importlib.util, "find_spec", lambda name: None)
    options = ["-o", tmp_path / "page.html"] if command == "report" else ["--html", tmp_path / "page.html"]
    code, _, error = run(command, tmp_path / ("report.json" if command == "report" else "a.c3d"), *options)
    assert code == 2
    assert "pip install '.[html]'" in error
    assert not (tmp_path / "page.html").exists()


@pytest.mark.parametrize("command", ["fill", "check", "report"])
def test_a_page_needs_the_name_of_a_file(tmp_path, monkeypatch, command):
    pytest.importorskip("bokeh", reason="bokeh is not installed (extra html)")
    store(tmp_path, "a.c3d")
    monkeypatch.chdir(tmp_path)
    assert run("fill", "a.c3d", "--method", "spline", "--no-self-check")[0] == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for place in (".", tmp_path, "/"):
        source, option = ("a_filled.c3d.report.json", "-o") if command == "report" else ("a.c3d", "--html")
        code, _, error = run(command, source, option, place, "--overwrite")
        assert code == 2
        assert "must be a file" in error
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
