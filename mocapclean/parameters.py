"""The declaration of a parameter: which values its class refuses, and its symbol, unit and meaning for the user."""

from dataclasses import dataclass

from pydantic import ConfigDict

STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
"""The configuration of every parameter class: an unknown name, a wrong type, NaN and infinity are refused."""


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


def about(params: type, name: str) -> About:
    """Return the ``About`` of a parameter of a class of parameters. KeyError or ValueError: there is none."""
    metadata = params.__pydantic_fields__[name].metadata  # type: ignore[attr-defined]
    (meaning,) = (item for item in metadata if isinstance(item, About))
    return meaning
