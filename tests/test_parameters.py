"""Every parameter that a user may set has a symbol, a unit and a meaning."""

from dataclasses import fields
from typing import Annotated

import pytest
from pydantic import ValidationError

from mocapclean.dictionaries import training_parameters
from mocapclean.evaluation import self_check
from mocapclean.parameters import About, Field, about, parameters


@parameters
class Params:
    weight: Annotated[float, Field(gt=0), About(symbol="λ √max(F, 3M)", unit="mm", text="weight, or none")] = 2.0
    plain: int = 1


def test_symbol_unit_and_text_stand_apart():
    assert about(Params, "weight") == About(symbol="λ √max(F, 3M)", unit="mm", text="weight, or none")
    assert str(about(Params, "weight")) == "λ √max(F, 3M), mm, weight, or none"
    assert About(symbol="k", text="a count").unit == "1"


def test_a_parameter_without_a_meaning_is_an_error():
    with pytest.raises(ValueError, match="the parameter plain must have one About"):
        about(Params, "plain")
    with pytest.raises(KeyError):
        about(Params, "absent")


@pytest.mark.parametrize("value", [0.0, float("nan"), "2"])
def test_the_range_and_the_type_are_still_enforced(value):
    with pytest.raises(ValidationError):
        Params(weight=value)


@pytest.mark.parametrize("params", [training_parameters.Params, self_check.Params])
def test_training_and_self_check_have_them_too(params):
    assert all(about(params, field.name).text for field in fields(params))
