import pytest

from stereomend.errors import InvalidParameter
from stereomend.refinement import PRESETS, parse_params
from stereomend.refinement.params import RefineParams
from stereomend.refinement.stage_params import FusionParams, GdrParams, LdrParams


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
    assert parse_params({"preset": "paper", "initial": "zero"}).gdr.levels == 6
    assert parse_params({"preset": "paper", "initial": "zero", "gdr": {"levels": 3}}).gdr.levels == 3
    assert parse_params({"initial": "zero"}).gdr.levels == PRESETS["robust"].gdr.levels


def test_robust_chooses_between_maps_and_works_at_three_quarters_of_the_size():
    params = parse_params({"preset": "robust"})
    assert params.fusion.enabled
    assert params.processing_scale == 0.75
    assert (params.ldr.method, params.ldr.specular) == ("evidence", "glint")
    assert params.gdr.observed_only
    assert params.gdr.averaging_px > 0
    assert params.gdr.edge_level > 0


@pytest.mark.parametrize("preset", ["paper", "released"])
def test_the_published_presets_do_nothing_that_was_not_published(preset):
    params = parse_params({"preset": preset})
    assert params.processing_scale == 0.5
    assert not params.fusion.enabled
    assert params.ldr.method == "smoothness"
    gdr = params.gdr
    assert (gdr.averaging_px, gdr.edge_level, gdr.prior_weight, gdr.fill_weight) == (0, None, 0, 0)
    assert (gdr.observed_only, gdr.reuse_margin, gdr.coarse_warps, gdr.coarse_iterations) == (
        False,
        None,
        0,
        0,
    )


@pytest.mark.parametrize("preset", PRESETS)
def test_the_working_size_and_the_choice_can_be_overridden_in_every_preset(preset):
    params = parse_params({"preset": preset, "processing_scale": 0.6, "fusion": {"win_margin": 0.3}})
    assert params.processing_scale == 0.6
    assert params.fusion == PRESETS[preset].fusion.model_copy(update={"win_margin": 0.3})


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_is_within_its_own_ranges(preset):
    """Constants that a preset is made of are checked like a client's."""
    made = PRESETS[preset]
    groups = {"ldr": made.ldr, "gdr": made.gdr, "fusion": made.fusion}
    sent = {name: group.model_dump() for name, group in groups.items()}
    assert parse_params({"preset": preset} | sent) == parse_params({"preset": preset})


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"preset": "best"}, "'best'.*paper, released"),
        ({"presets": "paper"}, "presets: unknown"),
        ({"gdr": {"warp": 3}}, "gdr.warp: unknown"),
        ({"gdr": {"warps": 0}}, "gdr.warps.*got 0"),
        ({"gdr": {"tau": 1.0, "sigma": 0.5}}, "8 \\* tau \\* sigma <= 1, got 4"),
        ({"gdr": 5}, "gdr: got 5"),
        ({"ldr": {"window": 4}}, "odd number, got 4"),
        ({"ldr": {"min_confidence": float("nan")}}, "ldr.min_confidence"),
        ({"stages": []}, "stages"),
        ({"stages": ["sgm"]}, "stages.*'sgm'"),
        ({"initial": "guess"}, "initial.*'guess'"),
        ({"processing_scale": 1.5}, "processing_scale.*1.5"),
        ({"disparity_scale": 0}, "disparity_scale.*got 0"),
        ({"preset": "robust", "fusion": {"toleranze_px": 1}}, "fusion.toleranze_px: unknown"),
        ({"fusion": 1}, "fusion: got 1"),
        ({"fusion": {"tolerance_px": 0}}, "fusion.tolerance_px.*got 0"),
        ({"fusion": {"max_doubt": 1.5}}, "fusion.max_doubt.*got 1.5"),
        ({"fusion": {"bend": float("inf")}}, "fusion.bend"),
        ({"gdr": {"averaging_px": 4.1}}, "gdr.averaging_px.*got 4.1"),
        ({"gdr": {"edge_floor": 0}}, "gdr.edge_floor.*got 0"),
        ({"gdr": {"prior_weight": -1}}, "gdr.prior_weight.*got -1"),
        ({"gdr": {"reuse_margin": 3}}, "gdr.reuse_margin.*got 3"),
        ({"ldr": {"method": "luck"}}, "ldr.method.*'luck'"),
        ({"ldr": {"specular": "shiny"}}, "ldr.specular.*'shiny'"),
        ({"preset": "robust", "processing_scale": 0}, "processing_scale.*got 0"),
    ],
)
def test_wrong_parameters_are_named(given, named):
    with pytest.raises(InvalidParameter, match=named):
        parse_params(given)


def test_all_wrong_parameters_are_named_at_once():
    with pytest.raises(InvalidParameter, match=r"(?s)gdr\.warps.*gdr\.foo|gdr\.foo.*gdr\.warps"):
        parse_params({"gdr": {"warps": -1, "foo": 1}})


def test_every_parameter_is_described_with_its_unit():
    for model in (LdrParams, GdrParams, FusionParams, RefineParams):
        for name, field in model.model_fields.items():
            assert field.description, name
    for model in (LdrParams, GdrParams, FusionParams):
        for name, field in model.model_fields.items():
            if field.annotation in (int, float):
                assert "[" in field.description, name
