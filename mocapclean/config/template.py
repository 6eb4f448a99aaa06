"""A configuration with every key and what it means, as YAML; and the JSON Schema of the configuration.

Both are made of the declarations of the settings: their types, their defaults, and the text at each field.
"""

import json
import textwrap
from collections.abc import Mapping
from io import StringIO
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from mocapclean.config.presets import PRESETS
from mocapclean.config.sections import Sections
from mocapclean.config.settings import Settings, TakeLimits
from mocapclean.json_values import plain
from mocapclean.parameters import checker

_WIDTH = 110  # characters of a line, as in the project's own texts
_INDENT = 2  # spaces of a section, as in the documents
_MOST_CHOICES = 6  # most words that a comment lists; chosen by hand, so that it stays on a line or two


def schema() -> dict[str, Any]:
    """Return the JSON Schema of a configuration (draft 2020-12), by which editors complete and check it."""
    found: dict[str, Any] = checker(Settings).json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **found, "title": "mocapclean configuration"}


def as_yaml(settings: Settings) -> str:
    """Return settings as YAML with a comment at every key; all keys are there, also those of unused methods.

    The parameters of methods and of trust rules, which are most of it, come last. Limits of a check that a preset sets
    are comments while they have their defaults, because a limit that is written comes before the preset.
    """
    by_size = sorted(settings, key=lambda named: isinstance(named[1], Sections))
    values = {name: plain(value) for name, value in by_size}
    document = schema()
    tree = _commented(values, document, document.get("$defs", {}), 0, {"check": _open_limits(settings.check)})
    tree.yaml_set_start_comment("A configuration of mocapclean with every key. A key that is left out has its default.")
    yaml = YAML()
    yaml.width = _WIDTH
    yaml.representer.add_representer(type(None), lambda own, _: own.represent_scalar("tag:yaml.org,2002:null", "null"))
    yaml.representer.add_representer(float, lambda own, x: own.represent_scalar("tag:yaml.org,2002:float", _number(x)))
    text = StringIO()
    yaml.dump(tree, text)
    return text.getvalue()


def _open_limits(limits: TakeLimits) -> frozenset[str]:
    """Return the names of the limits that are left to a preset: those with their defaults, where none is chosen."""
    if limits.preset is not None:
        return frozenset()
    default = TakeLimits()
    names = {name for preset in PRESETS.values() for name in preset}
    return frozenset(name for name in names if getattr(limits, name) == getattr(default, name))


def _commented(
    values: Mapping[str, Any],
    section: Mapping[str, Any],
    shared: Mapping[str, Any],
    depth: int,
    open_keys: Mapping[str, frozenset[str]],
    left_open: frozenset[str] = frozenset(),
) -> Any:
    """Return the values of a section with a comment before each key.

    section: its JSON Schema. shared: the definitions that it refers to. depth: of the section in others. open_keys: by
    section, its keys that are written as comments. left_open: those of this section.
    """
    tree, indent = CommentedMap(), _INDENT * depth
    waiting: list[str] = []
    for name, value in values.items():
        part = section["properties"][name]
        inner = shared[part["$ref"].rpartition("/")[2]] if "$ref" in part else part
        lines = textwrap.wrap(_meaning({**inner, **part}), _WIDTH - indent - len("# "))
        if name in left_open:
            waiting += [*lines, f"{name}: {json.dumps(value)}"]
            continue
        if "properties" in inner and value is not None:
            tree[name] = _commented(value, inner, shared, depth + 1, open_keys, open_keys.get(name, frozenset()))
        else:
            tree[name] = _inline(value)
        tree.yaml_set_comment_before_after_key(name, before="\n".join([*waiting, *lines]), indent=indent)
        waiting = []
    return tree


def _number(value: float) -> str:
    """Return a number as all versions of YAML read it: one with an exponent needs a point in YAML 1.1."""
    mantissa, exponent, power = repr(value).partition("e")
    return f"{mantissa}.0e{power}" if exponent and "." not in mantissa else repr(value)


def _inline(value: Any) -> Any:
    """Return a list on one line, and any other value as it is."""
    if not isinstance(value, list):
        return value
    items = CommentedSeq(value)
    items.fa.set_flow_style()
    return items


def _meaning(part: Mapping[str, Any]) -> str:
    """Return the text on a key, with the words that it may be."""
    text = " ".join(part.get("description", "").split())
    kinds = [part, *part.get("anyOf", ())]
    choices = [str(word) for kind in kinds for word in kind.get("enum", ())]
    if 1 < len(choices) <= _MOST_CHOICES:
        text = f"{text.rstrip('.')}. One of: {', '.join(choices)}"
    return text
