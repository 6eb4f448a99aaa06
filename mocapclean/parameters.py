"""What the parameters of solvers and trust rules share: an unknown name, a wrong type, NaN or inf is refused."""

from pydantic import ConfigDict

STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
