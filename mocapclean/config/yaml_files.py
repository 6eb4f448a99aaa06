"""YAML files as mappings with line numbers, and YAML scalars. Loaded only where there is YAML to read."""

from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap
from ruamel.yaml.error import YAMLError

from mocapclean.errors import ConfigError


def load_mapping(path: Path) -> CommentedMap:
    """Return the content of a YAML file, with line numbers; raise ConfigError if it is no mapping."""
    try:
        tree = YAML(typ="rt").load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}, byte {error.start}: a configuration must be UTF-8 text.") from None
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise ConfigError(f"{path}{line}: not valid YAML: {problem}.") from None
    except RecursionError:
        raise ConfigError(f"{path}: not valid YAML: it is nested too deeply.") from None
    except ValueError as error:
        raise ConfigError(f"{path}: not valid YAML: {error}.") from None
    if tree is None:
        return CommentedMap()
    if not isinstance(tree, CommentedMap):
        raise ConfigError(f"{path}, line 1: a configuration must be a mapping of keys to values.")
    return tree


def scalar(text: str) -> Any:
    """Return the value that a text is in YAML, or the text itself where it is no YAML."""
    if not text:
        return text
    try:
        return YAML(typ="safe", pure=True).load(text)
    except (YAMLError, ValueError, RecursionError):
        return text
