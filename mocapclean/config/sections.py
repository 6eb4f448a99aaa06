"""A section of the settings with one key for each module of a registry, such as ``methods`` and ``trust``."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import make_dataclass
from typing import Any, ClassVar

from mocapclean.parameters import STRICT
from mocapclean.registry import Modules


class Sections(Mapping[str, Any]):
    """The ``Params`` of modules by name; also as attributes.

    ``given`` are those that the user sets. The others have their defaults, and their modules are imported when they are
    asked for.
    """

    modules: ClassVar[Modules[Any]]

    def __init__(self, given: Mapping[str, Any] | None = None) -> None:
        self.given = dict(given or {})

    def __getitem__(self, name: str) -> Any:
        if name not in self.given:
            return self.modules[name].Params()
        return self.given[name]

    def __getattr__(self, name: str) -> Any:
        if name not in self.modules:
            raise AttributeError(f"{type(self).__name__} has no section {name!r}")
        return self[name]

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the project's modules, then those of other packages that the user sets."""
        return iter(dict.fromkeys((*self.modules, *self.given)))

    def __len__(self) -> int:
        return len({*self.modules, *self.given})

    def __eq__(self, other: object) -> bool:
        """Whether all parameters are the same; those that neither has been given need no comparison."""
        if type(other) is not type(self):
            return NotImplemented
        return all(self[name] == other[name] for name in {*self.given, *other.given})

    __hash__ = None  # type: ignore[assignment]

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        """Return pydantic's schema of a section, which checks the keys that are given."""
        from pydantic_core import core_schema

        return core_schema.no_info_plain_validator_function(cls._checked)

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: Any, handler: Any) -> Any:
        """Return the JSON Schema of a section, in which every module has its keys."""
        from pydantic import TypeAdapter

        names = (*cls.modules, *cls.modules.installed())
        parts = {name: TypeAdapter(cls.modules[name].Params).json_schema() for name in names}
        return {"type": "object", "properties": parts, "additionalProperties": False}

    @classmethod
    def _checked(cls, values: Any) -> "Sections":
        """Return the section of some values by key; raise pydantic's ValidationError, or ValueError for no mapping."""
        if isinstance(values, cls):
            return values
        if not isinstance(values, Mapping):
            raise ValueError("a mapping of keys to values")
        from pydantic import TypeAdapter

        # A class with the given keys alone, so that no other module is imported
        known = [(name, cls.modules[name].Params) for name in values if name in cls.modules]
        given: Any = make_dataclass(cls.__name__, known, namespace={"__pydantic_config__": STRICT})
        return cls(vars(TypeAdapter(given).validate_json(json.dumps(values))))
