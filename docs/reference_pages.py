"""A Sphinx extension: a block ``generated`` in a page is replaced by a part that is written from the code.

Each function of ``PARTS`` returns the Markdown of a part. ``configuration.schema.json`` is written beside the pages.
"""

import importlib
import inspect
import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from inspect import isclass
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

from mocapclean import errors
from mocapclean.cli import cli
from mocapclean.config.sections import Sections
from mocapclean.config.settings import DEFAULT_METHOD, MarkerLimits, Settings, TakeLimits
from mocapclean.config.template import schema
from mocapclean.detection import RULES
from mocapclean.experiments.protocols import EXPERIMENTS
from mocapclean.formats.declarations import DECLARATIONS
from mocapclean.json_values import plain
from mocapclean.parameters import checker
from mocapclean.solvers import SOLVERS
from mocapclean.take.status import MEANINGS, Status

REPORT_SCHEMA = Path(__file__).with_name("report.schema.json")
CONFIGURATION_SCHEMA = "configuration.schema.json"


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a Markdown table."""
    lines = [list(head), *([str(cell).replace("|", r"\|").replace("\n", " ") for cell in row] for row in rows)]
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def code(value: Any) -> str:
    """Return a value as JSON in a code span."""
    return f"`{json.dumps(plain(value), ensure_ascii=False)}`"


def first_sentence(text: str | None) -> str:
    """Return the first sentence of a docstring as Markdown."""
    whole = " ".join((text or "").split("\n\n")[0].split()).replace("``", "`")
    return re.split(r"(?<=[.:])\s", whole)[0].rstrip(":")


def allowed(schema: dict[str, Any], definitions: dict[str, Any]) -> str:
    """Return in words which values a JSON Schema allows."""
    if "$ref" in schema:
        return allowed(definitions[schema["$ref"].rsplit("/", 1)[1]], definitions)
    if "anyOf" in schema:
        return " or ".join(allowed(each, definitions) for each in schema["anyOf"])
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    if "const" in schema:
        return f"`{schema['const']}`"
    kind = schema.get("type", "any value")
    kind = " or ".join(kind) if isinstance(kind, list) else kind
    if kind == "array" and isinstance(schema.get("items"), dict):
        kind = f"list of {allowed(schema['items'], definitions)}"
    limits = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    return ", ".join([kind, *(f"{sign} {schema[key]:g}" for key, sign in limits.items() if key in schema)])


def parameter_table(params: type) -> str:
    """Return the table of a class of parameters: name, values, default and meaning; words where it has none."""
    if not fields(params):
        return "It has no parameters."
    schema = checker(params).json_schema()
    properties, definitions = schema["properties"], schema.get("$defs", {})
    rows = [
        (f"`{field.name}`", allowed(part, definitions), default(field), part.get("description", ""))
        for field in fields(params)
        for part in (properties[field.name],)
    ]
    return table(("parameter", "values", "default", "meaning"), rows)


def default(field: Field[Any]) -> str:
    """Return the default of a field; a section of parameters has none of its own."""
    value = field.default if field.default_factory is MISSING else field.default_factory()
    is_section = is_dataclass(value) or isinstance(value, Sections)
    return "" if is_section else code(value)


def commands() -> str:
    """Return every command with its options, by sphinx-click."""
    directives = [
        f".. click:: mocapclean.cli.{name}:command\n   :prog: mocapclean {name}\n   :nested: full\n"
        for name in cli.summaries
    ]
    return "```{eval-rst}\n" + "\n".join(directives) + "```"


def methods() -> str:
    """Return the table of all methods, and the parameters of each."""
    head = ("method", "what it is", "error bars", "ends of a take", "needs", "skeletons")
    rows, sections = [], []
    for name, module in SOLVERS.items():
        traits = module.TRAITS
        needs = ["a dictionary"] * traits.needs_dictionary + ["known bones"] * bool(traits.needs_bones)
        yes = ("no", "yes")
        rows.append(
            (
                f"[`{name}`](#{name}){' (default)' if name == DEFAULT_METHOD else ''}",
                first_sentence(module.__doc__),
                yes[traits.error_bars],
                yes[traits.extrapolates],
                ", ".join(needs),
                "rotations" if traits.turns_joints else "positions",
            )
        )
        sections.append(f"## `{name}`\n\n{first_sentence(module.__doc__)}\n\nSource: {module.REFERENCE}\n")
        sections.append(parameter_table(module.Params))
    return "\n\n".join([table(head, rows), *sections])


def rules() -> str:
    """Return every trust rule with its parameters."""
    sections = []
    for name, module in RULES.items():
        columns = " and ".join(getattr(module, "COLUMNS", ("markers",)))
        sections.append(f"## `{name}`\n\n{first_sentence(module.__doc__)} It judges {columns}.\n")
        sections.append(parameter_table(module.Params))
    return "\n\n".join(sections)


def statuses() -> str:
    """Return the table of the statuses of a sample."""
    rows = [(str(status.value), f"`{status.code}`", MEANINGS[status]) for status in Status]
    return table(("number", "status", "meaning"), rows)


def configuration() -> str:
    """Return the table of the keys of a configuration."""
    return parameter_table(Settings)


def limits() -> str:
    """Return the tables of the limits of a take and of single markers."""
    of_marker = parameter_table(MarkerLimits)
    return f"{parameter_table(TakeLimits)}\n\nLimits of single markers, under `check.markers`:\n\n{of_marker}"


def formats() -> str:
    """Return the table of the formats that can be read and written."""
    rows = [
        (
            name.upper(),
            ", ".join(f"`{suffix}`" for suffix in facts.suffixes),
            facts.columns,
            facts.stores,
            "yes" if facts.marks_missing else "no",
            f"`{facts.skeleton_suffix}`" if facts.skeleton_suffix else "",
        )
        for name, facts in DECLARATIONS.items()
    ]
    return table(("format", "suffix", "columns", "stores", "marks missing samples", "skeleton in"), rows)


def experiments() -> str:
    """Return the table of the experiments of ``bench``."""
    return table(("experiment", "what it is"), [(f"`{n}`", first_sentence(m.__doc__)) for n, m in EXPERIMENTS.items()])


def exit_codes() -> str:
    """Return the table of the exit codes, with the errors that lead to them."""
    classes = [c for _, c in inspect.getmembers(errors, isclass) if issubclass(c, errors.MocapcleanError)]
    rows = [("0", "all went well", "")]
    meanings = {1: "a take failed, or a limit is exceeded", 2: "the command or the configuration is wrong"}
    for number, meaning in meanings.items():
        names = [f"{{py:class}}`~mocapclean.errors.{c.__name__}`" for c in classes if c.exit_code == number]
        rows.append((str(number), meaning, ", ".join(names)))
    rows += [("130", "interrupted by Ctrl-C", ""), ("143", "ended by SIGTERM", "")]
    return table(("exit code", "meaning", "errors of the library"), rows)


def properties_of(schema: dict[str, Any], path: str = "") -> Iterator[tuple[str, str, str]]:
    """Yield path, type and description of every value that a JSON Schema describes by itself."""
    for name, value in schema.get("properties", {}).items():
        below = f"{path}.{name}" if path else name
        yield f"`{below}`", kind_of(value), value.get("description", "")
        inner = value.get("items", value)
        yield from properties_of(inner if isinstance(inner, dict) else {}, f"{below}[]" if "items" in value else below)


def kind_of(schema: dict[str, Any]) -> str:
    """Return the type of a value in a JSON Schema, with links to the definitions that it uses."""
    if "$ref" in schema:
        name = schema["$ref"].rsplit("/", 1)[1]
        return f"[{name}](#report-{name})"
    if "anyOf" in schema or "oneOf" in schema:
        return " or ".join(kind_of(each) for each in schema.get("anyOf", schema.get("oneOf", [])))
    if schema.get("type") == "array" and isinstance(schema.get("items"), dict):
        return f"list of {kind_of(schema['items'])}"
    kind = schema.get("type", "value")
    return " or ".join(kind) if isinstance(kind, list) else f"`{schema['const']}`" if "const" in schema else kind


def report() -> str:
    """Return the tables of all objects of the report, from its JSON Schema."""
    schema = json.loads(REPORT_SCHEMA.read_text(encoding="utf-8"))
    head = ("key", "type", "meaning")
    parts = ["## The whole report", schema["description"], table(head, properties_of(schema))]
    for name, definition in schema["$defs"].items():
        parts += [f"(report-{name})=\n## {name.replace('_', ' ').capitalize()}", definition.get("description", "")]
        parts.append(table(head, properties_of(definition)) if "properties" in definition else kind_of(definition))
        if "enum" in definition:
            parts.append(", ".join(f"`{value}`" for value in definition["enum"]))
    return "\n\n".join(parts)


PUBLIC = {
    "mocapclean": "The names that most programs need.",
    "mocapclean.errors": "All errors that the library raises on purpose.",
    "mocapclean.take": "Takes and their parts.",
    "mocapclean.take.session": "Other takes of a subject, to learn from.",
    "mocapclean.geometry.skeleton": "Skeletons and their bones.",
    "mocapclean.geometry.occluders": "Bodies and props that hide markers from cameras.",
    "mocapclean.simulate": "Takes with known truth, lost samples, and faults.",
    "mocapclean.dictionaries.dictionary": "What `mocapclean train` learns.",
    "mocapclean.dictionaries.body_parts": "The parts of the body that a dictionary is made of.",
    "mocapclean.geometry.body_frames": "The frames of reference of a body.",
    "mocapclean.solvers.method": "The declaration of a method.",
    "mocapclean.formats.contract": "The declaration of a format.",
    "mocapclean.parameters": "The declaration of parameters.",
    "mocapclean.registry": "The registry of methods, of rules and of formats.",
}
"""The modules whose names other programs may use."""


def public_names(module: str) -> list[str]:
    """Return the names that a module makes public: its ``__all__``, or those that it defines itself."""
    members = vars(importlib.import_module(module))
    own = [name for name, value in members.items() if getattr(value, "__module__", None) == module and name[0] != "_"]
    return [name for name in members.get("__all__", own) if not name.startswith("__")]


def api() -> str:
    """Return the documentation of every public name, by autodoc; a name of several modules is described once."""
    described, parts = set[int](), []
    for module, text in PUBLIC.items():
        lines = [f".. py:module:: {module}", ""]
        for name in public_names(module):
            value = getattr(importlib.import_module(module), name)
            again = id(value) in described
            described.add(id(value))
            lines += [*directive(module, name, value), *["   :no-index:"] * again, ""]
        parts += [f"## {module}", text, "```{eval-rst}\n" + "\n".join(lines) + "\n```"]
    return "\n\n".join(parts)


def directive(module: str, name: str, value: Any) -> list[str]:
    """Return the lines of the directive that documents a name; a constant has no documentation of its own object."""
    if isclass(value):
        return [f".. autoclass:: {module}.{name}", "   :members:"]
    if callable(value):
        return [f".. autofunction:: {module}.{name}"]
    return [
        f".. py:data:: {name}",
        f"   :type: {type(value).__name__}",
        "",
        f"   {constant_text(name, value)}",
    ]


def constant_text(name: str, value: Any) -> str:
    """Return the text below a constant in the module that defines it."""
    for module in [each for each in sys.modules if each.startswith("mocapclean.")]:
        if vars(sys.modules[module]).get(name) is value:
            documented = ModuleAnalyzer.for_module(module).find_attr_docs()
            if ("", name) in documented:
                return " ".join(documented["", name]).strip()
    return ""


PARTS: dict[str, Callable[[], str]] = {
    each.__name__: each
    for each in (
        commands,
        methods,
        rules,
        statuses,
        configuration,
        limits,
        formats,
        experiments,
        exit_codes,
        report,
        api,
    )
}
"""The parts that a page can have."""
BLOCK = re.compile(r"^```\{generated\} (\w+)\n```$", re.MULTILINE)
ARRAY = re.compile(r"[~\w.]*ndarray\[[~\w.]*tuple\[[~\w.]*Any, \.\.\.\], [~\w.]*dtype\[[~\w.]*?(float|bool|int)\d*\]\]")


def insert(app: Sphinx, document: str, source: list[str]) -> None:
    """Replace each block ``generated`` of a page by the part that it names."""
    source[0] = BLOCK.sub(lambda block: PARTS[block[1]](), source[0])


def shorten(app: Sphinx, kind: str, name: str, value: Any, options: Any, *signature: str | None) -> Any:
    """Return the arguments and the result of a function with the names of ``mocapclean.arrays`` for arrays."""
    return tuple(text and ARRAY.sub(lambda array: f"{array[1].title()}s", text) for text in signature)


def write_schema(app: Sphinx, exception: Exception | None) -> None:
    """Write the JSON Schema of a configuration beside the pages, as ``mocapclean config --schema`` does."""
    if exception is None:
        Path(app.outdir, CONFIGURATION_SCHEMA).write_text(json.dumps(schema(), indent=1), encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive and the file to a build."""
    app.connect("source-read", insert)
    app.connect("autodoc-process-signature", shorten)
    app.connect("build-finished", write_schema)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
