"""Settings from a YAML file and the command line; every refused value is named with its file, line and key."""

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from difflib import get_close_matches
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

from mocapclean.config.presets import with_preset
from mocapclean.config.sections import Sections
from mocapclean.config.settings import DEFAULT_METHOD, Settings
from mocapclean.errors import ConfigError
from mocapclean.parameters import NameIn, annotations, checker
from mocapclean.solvers import SOLVERS

if TYPE_CHECKING:
    from pydantic import ValidationError
    from pydantic_core import ErrorDetails

_MAX_VALUES = 10_000
"""Most values in a configuration, aliases expanded; chosen by hand, over ten times the number of keys."""

_PATH_KEYS = ("skeleton", "dictionary", "gaps", "reference", "output", "out_dir", "report", "html", "sidecar")


def resolve(path: Path | None, options: Mapping[str, Any], assignments: Sequence[str] = ()) -> Settings:
    """Return settings from a YAML file, the command's options and ``--set`` assignments; later sources win.

    options: values by key. assignments: "name=value" for a parameter of the chosen method, "a.b=value" for any key.
    Paths in the file are relative to its folder. Raises ConfigError with one line per invalid value.
    """
    tree: Mapping[str, Any] = {}
    if path:
        from mocapclean.config.yaml_files import load_mapping  # the YAML library is not needed without a file

        tree = load_mapping(path)
    try:
        values = _plain(tree, iter(range(_MAX_VALUES)))
    except (StopIteration, RecursionError):
        raise ConfigError(f"{path}: a configuration must have fewer than {_MAX_VALUES:,} values.") from None
    if path:
        for key in _PATH_KEYS:
            if isinstance(values.get(key), str):
                values[key] = path.parent / values[key]
        if isinstance(values.get("learn_from"), list):
            listed = values["learn_from"]
            values["learn_from"] = [path.parent / each if isinstance(each, str) else each for each in listed]
    values.update(options)
    for assignment in assignments:
        _assign(values, assignment)
    if "check" in values:
        values["check"] = with_preset(values["check"])
    settings = _validated(values, path, tree)
    contradictions = [f"{path or 'command line'}: {message}" for message in _contradictions(settings)]
    if contradictions:
        raise ConfigError("\n".join(contradictions))
    return settings


def _validated(values: Mapping[str, Any], path: Path | None, tree: Mapping[str, Any]) -> Settings:
    """Return settings with these values; raise ConfigError with one line per invalid value."""
    types = annotations(Settings)
    if all(name in types and _is_plainly(types[name], value) for name, value in values.items()):
        return Settings().but(**values)
    from pydantic import ValidationError  # it takes longer to load than a small take to read

    try:
        # Strict validation from JSON accepts mappings for sections and text for paths, but no text for numbers.
        settings: Settings = checker(Settings).validate_json(json.dumps(values, default=str))
    except ValidationError as invalid:
        messages = [_message(error, path, tree) for error in _merged(invalid)]
        raise ConfigError("\n".join(messages)) from None
    return settings


def _is_plainly(annotation: Any, value: Any) -> bool:
    """Whether a value is a truth value, a path, or one of some words, and is of this type without any check."""
    if get_origin(annotation) is Literal:
        return value in get_args(annotation)
    if get_origin(annotation) is Annotated:
        return any(isinstance(each, NameIn) and value in each for each in annotation.__metadata__)
    if get_origin(annotation) in (Union, UnionType):
        return any(_is_plainly(kind, value) for kind in get_args(annotation))
    return annotation in (bool, Path) and isinstance(value, annotation)


def _contradictions(settings: Settings) -> Iterator[str]:
    """Yield a message for each value that has the right type but is impossible or conflicts with another value."""
    for name, value in settings:
        if isinstance(value, Path) and "\0" in str(value):
            yield f"{name} must be a path, without NUL. Got {str(value)!r}."
    try:
        limit = settings.left_limit(100)
    except ValueError:
        limit = -1.0
    if limit is not None and not 0 <= limit < float("inf"):
        yield f"max_left must be a number of samples or a percentage. Got {settings.max_left!r}."
    if settings.grades.good > settings.grades.fair:
        yield f"grades.good must be at most grades.fair, {settings.grades.fair:g}. Got {settings.grades.good:g}."
    methods = settings.auto.methods if settings.method == "auto" else (settings.method,)
    if settings.max_error is not None and not any(SOLVERS[name].TRAITS.error_bars for name in methods):
        bars = ", ".join(name for name, module in SOLVERS.items() if module.TRAITS.error_bars)
        got = ", ".join(methods)
        yield f"max_error must go with a method that gives error bars: {bars}. Got {got}."
    if settings.learn_from and not any(SOLVERS[name].TRAITS.learns_from_session for name in methods):
        learning = ", ".join(name for name, module in SOLVERS.items() if module.TRAITS.learns_from_session)
        yield f"learn_from must go with a method that learns from other takes: {learning}. Got {', '.join(methods)}."
    yield from _exclusions(settings)


def _exclusions(settings: Settings) -> Iterator[str]:
    """Yield a message for each pair of options of which one excludes the other."""
    if settings.frames is not None and settings.events is not None:
        yield "frames and events both name the frames to repair. Give one."
    if not settings.auto.methods:
        yield "auto.methods must name at least one method. Got none."
    if settings.method == "auto" and not settings.checks_itself:
        yield "method auto needs the self-check to compare methods. Set self_check to true or auto. Got false."


def _plain(node: Any, budget: Iterator[int]) -> Any:
    """Return a YAML node as plain dicts, lists and scalars.

    Every node takes one item of ``budget``, because nested aliases can expand a few lines to any number of values.
    Raises StopIteration when the budget is used up.
    """
    next(budget)
    if isinstance(node, Mapping):
        return {str(key): _plain(value, budget) for key, value in node.items()}
    if isinstance(node, list):
        return [_plain(item, budget) for item in node]
    for scalar in (bool, int, float, str):  # a bool is an int as well, so it comes first
        if isinstance(node, scalar):
            return scalar(node)
    return node


def _assign(values: dict[str, Any], assignment: str) -> None:
    """Set the value that a ``--set`` assignment names; raise ConfigError for a malformed assignment."""
    name, equals, text = assignment.partition("=")
    if not equals or not name:
        raise ConfigError(f"--set must be name=value. Got {assignment!r}.")
    from mocapclean.config.yaml_files import scalar  # the YAML library is not needed without an assignment

    keys = name.split(".") if "." in name else ["methods", str(values.get("method", DEFAULT_METHOD)), name]
    section = values
    for key in keys[:-1]:
        section = section.setdefault(key, {})
        if not isinstance(section, dict):
            raise ConfigError(f"--set {assignment}: {key!r} is a value, not a section.")
    section[keys[-1]] = scalar(text)


def _merged(invalid: "ValidationError") -> "Iterable[ErrorDetails]":
    """Return one error per key.

    For a value of several possible types, validation reports one error per type; their messages are joined by "or".
    """
    errors: dict[tuple[str, ...], ErrorDetails] = {}
    for error in invalid.errors(include_url=False):
        keys = tuple(_keys(error["loc"]))
        if keys in errors:
            errors[keys]["msg"] += f" or {error['msg'].removeprefix('Input should be ')}"
        else:
            errors[keys] = error
    return errors.values()


def _keys(location: tuple[int | str, ...]) -> Iterator[str]:
    """Yield the part of an error's location that consists of keys of the settings."""
    section: Any = Settings
    for key in location:
        names = names_of(section)
        if names is None and isinstance(key, str):
            return  # the name of one of several possible types
        yield str(key)
        if names is None or key not in names:
            return
        section = section_of(section, str(key))


def names_of(section: Any) -> Collection[str] | None:
    """Return the keys of a section; None for the type of a value."""
    if not isinstance(section, type):
        return None
    if issubclass(section, Sections):
        return section.modules
    return list(annotations(section)) if is_dataclass(section) else None


def section_of(section: type, key: str) -> Any:
    """Return the section, or the type of the value, under a key of a section."""
    return section.modules[key].Params if issubclass(section, Sections) else annotations(section)[key]


def _message(error: "ErrorDetails", path: Path | None, tree: Mapping[str, Any]) -> str:
    """Return one line for the user: where the value stands, what it must be and what it is."""
    keys = list(_keys(error["loc"]))
    line = _line(tree, keys)
    source = f"{path}, line {line}" if line else "command line"
    name = ".".join(keys)
    if error["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        section: Any = Settings
        for key in keys[:-1]:
            section = section_of(section, key)
        allowed = sorted(names_of(section) or ())
        similar = get_close_matches(keys[-1], allowed, n=1)
        hint = f" Did you mean {similar[0]!r}?" if similar else ""
        return f"{source}: unknown key {name!r}.{hint} Allowed: {', '.join(allowed) or 'none'}."
    requirement = error["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    return f"{source}: {name} must be {requirement}. Got {error['input']!r}."


def _line(tree: Any, keys: Sequence[str]) -> int | None:
    """Return the line, from 1, of the value under these keys; None if the file does not set it."""
    line = None
    for key in keys:
        if not isinstance(tree, Mapping) or key not in tree:
            return line if line and not isinstance(tree, Mapping) else None
        line = tree.lc.key(key)[0] + 1  # type: ignore[attr-defined]
        tree = tree[key]
    return line
