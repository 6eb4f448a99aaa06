"""The declaration of parameters: which values a class refuses, and the symbol, unit and meaning of each for the user.

pydantic checks the values. It is loaded with the first value that is given, because loading it takes longer than
reading a small take. A class that keeps its defaults needs no check.
"""

import copy
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, dataclass_transform, get_origin

from mocapclean.registry import Modules

if TYPE_CHECKING:
    from pydantic import TypeAdapter

T = TypeVar("T")


STRICT = {"extra": "forbid", "strict": True, "allow_inf_nan": False, "use_attribute_docstrings": True}
"""pydantic's configuration of all classes of parameters: unknown names, wrong types, NaN and infinity are refused.

The text below a field describes it in the JSON Schema.
"""


@dataclass(frozen=True, kw_only=True)
class About:
    """The meaning of a parameter, as part of its annotation: ``Annotated[float, Field(gt=0), About(...)]``.

    symbol: its letter in the equations of the module. unit: "1" for a number without one. text: its meaning.
    """

    symbol: str
    unit: str = "1"
    text: str

    def __str__(self) -> str:
        return f"{self.symbol}, {self.unit}, {self.text}"

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Any) -> Any:
        """Return the JSON Schema of the annotated type with the meaning as its description."""
        return {**handler(core_schema), "description": str(self)}


class Field:
    """The values that a parameter may have, as part of its annotation; the names are those of ``pydantic.Field``."""

    def __init__(self, **limits: Any) -> None:
        self.limits = limits

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return pydantic's schema of the annotated type within the limits."""
        from pydantic import Field as PydanticField

        return handler.generate_schema(Annotated[source, PydanticField(**self.limits)])


class NameIn:
    """A name in a registry, or one of some further words; part of the annotation of a text."""

    def __init__(self, names: Modules[Any], *words: str) -> None:
        self.names, self.words = names, words

    def __contains__(self, value: object) -> bool:
        return isinstance(value, str) and (value in self.words or value in self.names)

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return pydantic's schema of such a name."""
        from pydantic_core import core_schema

        return core_schema.no_info_after_validator_function(self._known, handler(source))

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Any) -> Any:
        """Return the JSON Schema of such a name."""
        return {"type": "string", "enum": [*self.names, *self.words]}

    def _known(self, value: str) -> str:
        if value not in self:
            *most, last = map(repr, (*self.names, *self.names.installed(), *self.words))
            raise ValueError(f"{', '.join(most)} or {last}")
        return value


Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
AtLeastOne = Annotated[int, Field(gt=0)]


@dataclass_transform(kw_only_default=True, frozen_default=True)
def parameters(declared: type[T]) -> type[T]:
    """Return a class as a frozen dataclass that checks the values it is given.

    A value that pydantic refuses, by ``STRICT``, by its type or by its ``Field``, raises pydantic's ValidationError.
    """
    checked = dataclass(frozen=True, kw_only=True)(declared)
    with_defaults = checked.__init__

    def __init__(self: Any, **values: Any) -> None:  # noqa: N807
        if values:
            from pydantic_core import ArgsKwargs

            check: Any = checker(checked)  # type: ignore[arg-type]
            check.validator.validate_python(ArgsKwargs((), values), self_instance=self)
        else:
            with_defaults(self)

    checked.__init__ = __init__  # type: ignore[method-assign]
    checked.__pydantic_config__ = STRICT  # type: ignore[attr-defined]
    return checked


def but(params: T, **changes: Any) -> T:
    """Return a copy of parameters with changed values, which are known to be valid and are not checked."""
    changed = copy.copy(params)
    vars(changed).update(changes)
    return changed


@cache
def checker(params: Any) -> "TypeAdapter[Any]":
    """Return pydantic's validator of a class of parameters."""
    from pydantic import TypeAdapter

    return TypeAdapter(params)


def faults(params: type, values: Mapping[str, Any]) -> list[tuple[str, str, Any]]:
    """Return the name, the fault and the value of each parameter that a class refuses; empty where all are valid."""
    if not values:
        return []
    from pydantic import ValidationError

    try:
        params(**values)
    except ValidationError as invalid:
        return [(str(each["loc"][0]), each["msg"], each["input"]) for each in invalid.errors()]
    return []


def annotations(params: type) -> Mapping[str, Any]:
    """Return the annotation of each parameter of a class, in order."""
    return {field.name: field.type for field in fields(params)}


def about(params: type, name: str) -> About:
    """Return the ``About`` of a parameter of a class of parameters. KeyError or ValueError: there is none."""
    annotation = annotations(params)[name]
    metadata = annotation.__metadata__ if get_origin(annotation) is Annotated else ()
    meanings = [item for item in metadata if isinstance(item, About)]
    if len(meanings) != 1:
        raise ValueError(f"the parameter {name} must have one About in its annotation")
    return meanings[0]


def fault_of(params: Any) -> str:
    """Return why something is no class of parameters with defaults, "" where it is one."""
    if not isinstance(params, type) or "__pydantic_config__" not in vars(params):
        return "Params must be a class with the decorator parameters"
    own = (field for field in fields(params) if field.default is MISSING and field.default_factory is MISSING)
    bare = ", ".join(field.name for field in own)
    return f"Params must have a default for {bare}" if bare else ""
