"""Compare takes and what they hold by content: arrays value by value, where NaN is equal to NaN."""

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def same_content(one: Any, other: Any, skip: tuple[str, ...] = ()) -> bool:
    """Whether two values are equal; dataclasses field by field without those of ``skip``, arrays with equal shapes."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == other.dtype.kind == "f")
    if type(one) is not type(other):
        return False
    if is_dataclass(one):
        return all(
            same_content(getattr(one, field.name), getattr(other, field.name))
            for field in fields(one)
            if field.name not in skip
        )
    return bool(one == other)
