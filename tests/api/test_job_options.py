import pytest

from stereomend.api.job_options import JobOptions, params_schema, take_options
from stereomend.errors import InvalidParameter
from stereomend.refinement import parse_params


def test_what_is_said_of_the_job_is_parted_from_what_is_said_of_the_refinement():
    given = {"preset": "paper", "priority": 5, "deadline_s": 10, "keep_inputs": True, "gdr": {"warps": 2}}
    options, rest = take_options(given)
    assert options == JobOptions(priority=5, deadline_s=10.0, keep_inputs=True)
    assert rest == {"preset": "paper", "gdr": {"warps": 2}}


def test_by_default_a_job_is_like_others_and_keeps_nothing():
    assert take_options({})[0].model_dump() == {"priority": 0, "deadline_s": None, "keep_inputs": False}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("priority", 101),
        ("priority", 1.5),
        ("priority", "5"),
        ("priority", True),
        ("deadline_s", 0),
        ("deadline_s", float("nan")),
        ("deadline_s", "soon"),
        ("keep_inputs", 1),
        ("keep_inputs", None),
    ],
)
def test_a_wrong_option_is_named(name, value):
    with pytest.raises(InvalidParameter, match=name):
        take_options({name: value})


def test_the_schema_has_all_that_params_may_hold():
    properties = params_schema()["properties"]
    assert {*JobOptions.model_fields, *parse_params({}).model_dump()} == set(properties)
