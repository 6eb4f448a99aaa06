"""Write the page of a run: the template with its style, scripts and data; the chart library from its Python package."""

import importlib.util
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from mocapclean import __version__
from mocapclean.errors import UsageError
from mocapclean.files import make_folder, new_file
from mocapclean.report.attention import LEVELS, attention
from mocapclean.report.page.packing import Packer
from mocapclean.report.page.places import data_folder
from mocapclean.report.page.words import citation, methods_paragraph
from mocapclean.report.vocabulary import KINDS, statuses

_HERE = Path(__file__).parent
_SCRIPTS = (
    "unpacking",
    "series",
    "text",
    "charts",
    "overview",
    "map",
    "curves",
    "bones",
    "player",
    "lists",
    "take",
    "main",
)
"""The page's own scripts, each after those that it imports from."""
_LIBRARY = ("bokeh.min.js", "bokeh-api.min.js")
_IMPORT = re.compile(r'^import (\{.*?\}) from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:function|class|const) (\w+))", re.MULTILINE)


@dataclass(frozen=True, kw_only=True)
class PageTake:
    """A take of a page: its row of the report, and the file of its data, or None if it has none."""

    row: Mapping[str, Any]
    data: Path | None


def require_library() -> None:
    """Raise UsageError unless the packages of the extra ``html`` are installed."""
    missing = [name for name in ("jinja2", "bokeh") if importlib.util.find_spec(name) is None]
    if missing:
        raise UsageError(f"a page needs {' and '.join(missing)}. Run pip install '.[html]' in the clone of mocapclean.")


def write_page(path: Path, takes: Iterable[PageTake], *, embed: bool) -> None:
    """Write the page of some takes.

    embed: whether the takes' data and the library stand in the page itself; else they stay in its folder, and their
    files are loaded when a take is shown. Raises UsageError without the extra ``html``.
    """
    require_library()
    from jinja2 import Environment, FileSystemLoader, select_autoescape
    from markupsafe import Markup

    rows, data = [], []
    for take in takes:
        rows.append(_summary(take))
        if embed and take.data:
            data.append(Markup(take.data.read_text(encoding="ascii")))
    overview = Packer().text(
        {
            "takes": rows,
            "levels": LEVELS,
            "kinds": [asdict(kind) for kind in KINDS],
            "statuses": statuses(),
            "version": __version__,
            "citation": citation(),
        }
    )
    files = data_folder(path)
    if not embed:
        _copy_library(files)
    environment = Environment(loader=FileSystemLoader(_HERE), autoescape=select_autoescape(), trim_blocks=True)
    page = environment.get_template("page.html").stream(
        title=rows[0]["name"] if len(rows) == 1 else f"{len(rows)} takes",
        style=Markup((_HERE / "page.css").read_text(encoding="utf-8")),
        overview=overview,
        folder="" if embed else files.name,
        files=[] if embed else _LIBRARY,
        libraries=[Markup(text) for text in _library()] if embed else [],
        takes=data,
        script=Markup(_own_script()),
        version=__version__,
    )
    with new_file(path) as part, part.open("wb") as file:
        page.dump(file, encoding="utf-8")


def _copy_library(folder: Path) -> None:
    """Write the library beside the takes' data; what an earlier run wrote is replaced."""
    make_folder(folder)
    for name, text in zip(_LIBRARY, _library(), strict=True):
        with new_file(folder / name) as part:
            part.write_text(text, encoding="utf-8", newline="\n")


def _library() -> Sequence[str]:
    """Return the scripts of the chart library, from the package, which is found but not imported."""
    spec = importlib.util.find_spec("bokeh")
    assert spec is not None
    assert spec.origin is not None
    folder = Path(spec.origin).parent / "server" / "static" / "js"
    return [_inline((folder / name).read_text(encoding="utf-8")) for name in _LIBRARY]


def _inline(script: str) -> str:
    """Return a script in which nothing ends or nests the element that it stands in."""
    return script.replace("</script", "<\\/script").replace("<!--", "<\\!--")


@cache
def _own_script() -> str:
    """Return the page's own scripts as one, because a page from a file may not import modules."""
    return _inline("\n".join(_module(name) for name in _SCRIPTS))


def _module(name: str) -> str:
    """Return a module as a function that returns its exports and takes its imports from those of earlier ones."""
    text = (_HERE / "scripts" / f"{name}.js").read_text(encoding="utf-8")
    exports = [found[1] for found in _EXPORT.findall(text)]
    body = _EXPORT.sub(r"\1", _IMPORT.sub(r"const \1 = \2_module;", text))
    return f"const {name}_module = (() => {{\n{body}\nreturn {{ {', '.join(exports)} }};\n}})();"


def _summary(take: PageTake) -> dict[str, Any]:
    """Return what the overview shows of a take."""
    row = take.row
    found = attention(row)
    counts = row.get("counts") or {}
    source = Path(row["source"])
    check = (((row.get("self_check") or {}).get("total") or {}).get("error") or {}).get("rmse_3d")
    bones = (row.get("bones") or {}).get("skeleton_rmse") or {}
    expected = [
        gap["expected_3d"] for gap in row.get("gaps", ()) if gap["expected_3d"] is not None and gap["samples_filled"]
    ]
    return {
        "key": take.data.stem if take.data else None,
        "name": source.name,
        "folder": str(source.parent),
        "status": row.get("status") or ("passed" if row["passes"] else "failed the check"),
        "level": LEVELS.index(found.level),
        "points": round(found.points, 2),
        "reasons": found.reasons,
        "frames": row["frames"],
        "markers": row["markers"],
        "rate": row.get("rate") or row.get("measures", {}).get("rate") or 0,
        "format": row["format"],
        "samples": counts.get("samples", 0),
        "shares": _shares(row, counts),
        "gaps": len(row.get("gaps", ())),
        "expected": max(expected, default=None),
        "check": check,
        "bones": [bones.get("before"), bones.get("after")],
        "methods": methods_paragraph(row),
    }


def _shares(row: Mapping[str, Any], counts: Mapping[str, int]) -> dict[str, int]:
    """Return the numbers of samples by kind, and of filled ones by grade."""
    if not counts:
        return {}
    filled = counts["filled"] - counts["replaced"]
    grades = {"good": 0, "fair": 0, "poor": 0}
    for gap in row["gaps"]:
        if gap["grade"]:
            grades[gap["grade"]] += gap["samples_filled"] - gap["samples_replaced"]
    was_filled = bool(row.get("method"))
    supplied = counts["filled"] + counts["left"] + counts["moved"] + counts["suspicious"]
    return {
        "measured": counts["samples"] - supplied,
        "filled": filled,
        **grades,
        "replaced": counts["replaced"],
        "moved": counts["moved"],
        "suspicious": counts["suspicious"],
        "missing": 0 if was_filled else counts["missing"],
        "distrusted": 0 if was_filled else counts["left"] - counts["missing"],
        "left": counts["left"] if was_filled else 0,
        "outside": counts["outside"],
    }
