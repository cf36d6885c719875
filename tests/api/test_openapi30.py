import pytest
from openapi_schema_validator import OAS30Validator
from pydantic import BaseModel

from stereomend.api.openapi30 import as_openapi_30


class Inner(BaseModel):
    number: int


class Outer(BaseModel):
    text: str | None
    inner: Inner | None
    either: int | Inner | None
    plain: Inner


def accepts(**values):
    given = {"text": "a", "inner": None, "either": None, "plain": {"number": 1}} | values
    document = as_openapi_30(Outer.model_json_schema(ref_template="#/$defs/{model}"))
    return OAS30Validator(document).is_valid(given)


def test_what_may_be_null_may_be_null():
    assert accepts(text=None)
    assert accepts(inner={"number": 2})
    assert accepts(either=3)
    assert accepts(either={"number": 3})


@pytest.mark.parametrize(
    ("name", "value"), [("text", 1), ("inner", {}), ("inner", 1), ("either", "a"), ("plain", None)]
)
def test_nothing_else_is_let_through(name, value):
    assert not accepts(**{name: value})


def test_examples_are_left_as_they_are():
    node = {"example": {"anyOf": [{"type": "null"}], "examples": [1]}, "schema": {"examples": [1, 2]}}
    assert as_openapi_30(node) == {"example": node["example"], "schema": {"example": 1}}
