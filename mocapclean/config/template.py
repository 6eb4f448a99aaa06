"""A configuration with every key and what it means, as YAML; and the JSON Schema of the configuration.

Both are made of the declarations of the settings: their types, their defaults, and the text at each field.
"""

import textwrap
from collections.abc import Mapping
from io import StringIO
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from mocapclean.config.sections import Sections
from mocapclean.config.settings import Settings
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

    The parameters of methods and of trust rules, which are most of it, come last.
    """
    by_size = sorted(settings, key=lambda named: isinstance(named[1], Sections))
    values = {name: plain(value) for name, value in by_size}
    document = schema()
    tree = _commented(values, document, document.get("$defs", {}), 0)
    tree.yaml_set_start_comment("A configuration of mocapclean with every key. A key that is left out has its default.")
    yaml = YAML()
    yaml.width = _WIDTH
    yaml.representer.add_representer(type(None), lambda own, _: own.represent_scalar("tag:yaml.org,2002:null", "null"))
    text = StringIO()
    yaml.dump(tree, text)
    return text.getvalue()


def _commented(values: Mapping[str, Any], section: Mapping[str, Any], shared: Mapping[str, Any], depth: int) -> Any:
    """Return the values of a section with a comment before each key.

    section: its JSON Schema. shared: the definitions that it refers to. depth: of the section in others.
    """
    tree, indent = CommentedMap(), _INDENT * depth
    for name, value in values.items():
        part = section["properties"][name]
        inner = shared[part["$ref"].rpartition("/")[2]] if "$ref" in part else part
        if "properties" in inner and value is not None:
            tree[name] = _commented(value, inner, shared, depth + 1)
        else:
            tree[name] = _inline(value)
        lines = textwrap.wrap(_meaning({**inner, **part}), _WIDTH - indent - len("# "))
        tree.yaml_set_comment_before_after_key(name, before="\n".join(lines), indent=indent)
    return tree


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
