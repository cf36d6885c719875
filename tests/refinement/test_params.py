import pytest

from stereomend.errors import InvalidParameter
from stereomend.refinement import PRESETS, parse_params
from stereomend.refinement.params import GdrParams, LdrParams, RefineParams


def test_the_presets_hold_the_published_constants():
    paper, released = PRESETS["paper"], PRESETS["released"]
    assert (paper.ldr.smoothness_weight, paper.ldr.photometric_weight) == (20, 2)
    assert (paper.ldr.min_saturation, paper.ldr.min_confidence) == (0.1, 0.5)
    assert (paper.gdr.data_weight, paper.gdr.huber_epsilon) == (0.5, 0.1)
    assert (paper.gdr.levels, paper.gdr.warps, paper.gdr.iterations) == (4, 50, 5)
    assert (released.gdr.data_weight, released.gdr.warps, released.gdr.iterations) == (0.375, 5, 30)
    assert (released.ldr.photometric_weight, released.ldr.smoothness_power) == (0, 2)


def test_overrides_leave_the_rest_of_the_preset():
    params = parse_params({"preset": "released", "gdr": {"warps": 9}, "ldr": {"window": 11}})
    assert params.gdr == PRESETS["released"].gdr.model_copy(update={"warps": 9})
    assert params.ldr == PRESETS["released"].ldr.model_copy(update={"window": 11})


def test_starting_from_zero_takes_six_levels_unless_told_otherwise():
    assert parse_params({"initial": "zero"}).gdr.levels == 6
    assert parse_params({"initial": "zero", "gdr": {"levels": 3}}).gdr.levels == 3


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"preset": "best"}, "'best'.*paper, released"),
        ({"presets": "paper"}, "presets: unknown"),
        ({"gdr": {"warp": 3}}, "gdr.warp: unknown"),
        ({"gdr": {"warps": 0}}, "gdr.warps.*got 0"),
        ({"gdr": {"tau": 1.0}}, "8 \\* tau \\* sigma <= 1, got 4"),
        ({"gdr": 5}, "gdr: got 5"),
        ({"ldr": {"window": 4}}, "odd number, got 4"),
        ({"ldr": {"min_confidence": float("nan")}}, "ldr.min_confidence"),
        ({"stages": []}, "stages"),
        ({"stages": ["sgm"]}, "stages.*'sgm'"),
        ({"initial": "guess"}, "initial.*'guess'"),
        ({"processing_scale": 1.5}, "processing_scale.*1.5"),
        ({"disparity_scale": 0}, "disparity_scale.*got 0"),
    ],
)
def test_wrong_parameters_are_named(given, named):
    with pytest.raises(InvalidParameter, match=named):
        parse_params(given)


def test_all_wrong_parameters_are_named_at_once():
    with pytest.raises(InvalidParameter, match=r"(?s)gdr\.warps.*gdr\.foo|gdr\.foo.*gdr\.warps"):
        parse_params({"gdr": {"warps": -1, "foo": 1}})


def test_every_parameter_is_described_with_its_unit():
    for model in (LdrParams, GdrParams, RefineParams):
        for name, field in model.model_fields.items():
            assert field.description, name
    for model in (LdrParams, GdrParams):
        for name, field in model.model_fields.items():
            if field.annotation in (int, float):
                assert "[" in field.description, name
