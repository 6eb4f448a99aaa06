"""Strict validation of parameters: unknown names, wrong types, NaN and infinity are refused."""

from pydantic import ConfigDict

STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
