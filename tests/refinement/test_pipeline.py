"""Whole runs: against exact phantoms, against the reference, and on inputs nobody should send."""

import numpy as np
import pytest

from stereomend import refine
from stereomend.disparity import Provenance
from stereomend.errors import (
    BackendUnavailable,
    InvalidParameter,
    NoValidDisparity,
    ShapeMismatch,
    UnknownFormat,
)
from stereomend.phantom import break_disparity, make_phantom

PRESETS = ["paper", "released"]


def rmse(disparity, truth):
    return float(np.sqrt(np.mean((disparity.astype(float) - truth) ** 2)))


@pytest.fixture(scope="module")
def phantom():
    return make_phantom(3, 320, 256)


@pytest.fixture(scope="module")
def broken(phantom):
    return break_disparity(phantom, 3).values


def run(phantom, disparity=None, **params):
    return refine(phantom.pair.left, phantom.pair.right, disparity, **params)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_broken_map_comes_out_much_better(phantom, broken, preset):
    refined = run(phantom, broken, preset=preset).disparity
    assert rmse(refined, phantom.truth) < 0.5 * rmse(broken, phantom.truth)


def test_the_local_stage_alone_improves_and_keeps_bit_for_bit(phantom, broken):
    result = run(phantom, broken, stages=["ldr"])
    assert rmse(result.disparity, phantom.truth) < 0.9 * rmse(broken, phantom.truth)
    kept = result.provenance == Provenance.KEPT
    assert kept.mean() > 0.2
    assert (result.disparity[kept] == broken[kept]).all()
    assert set(np.unique(result.provenance)) <= {Provenance.KEPT, Provenance.FILLED, Provenance.UNOBSERVED}


def test_the_global_stage_alone_fills_and_refines(phantom, broken):
    result = run(phantom, broken, stages=["gdr"])
    assert (
        result.provenance[(broken == 0) & (result.provenance != Provenance.UNOBSERVED)] == Provenance.FILLED
    ).all()
    assert result.timings["ldr"] == 0.0 < result.timings["gdr"]


@pytest.mark.parametrize(
    ("preset", "near", "share", "wide", "wide_share"),
    [("released", 0.01, 0.999, 0.05, 0.999), ("paper", 0.01, 0.997, 0.05, 0.999)],
)
def test_whole_runs_match_the_reference(phantom, broken, preset, near, share, wide, wide_share):
    maps = [run(phantom, broken, preset=preset, backend=name).disparity for name in ("native", "reference")]
    error = np.abs(maps[0].astype(float) - maps[1])
    assert np.mean(error <= near) >= share
    assert np.mean(error <= wide) >= wide_share


def test_whole_results_are_bitwise_equal_for_any_number_of_threads(phantom, broken):
    results = [run(phantom, broken, threads=threads) for threads in (1, 2, 5)]
    for name in ("disparity", "confidence", "provenance", "input_confidence"):
        assert len({getattr(result, name).tobytes() for result in results}) == 1


def test_the_upload_decides_where_zero_is_too_far_away():
    """Disparities over 60 px at working size: the coarsest level cannot reach them from zero."""
    phantom = make_phantom(4, 800, 256, max_disparity=160)
    assert phantom.truth.mean() / 2 > 50
    near = phantom.truth + np.random.default_rng(0).uniform(-3, 3, phantom.truth.shape).astype(np.float32)
    same = {"preset": "released", "gdr": {"levels": 4}}
    helped = rmse(run(phantom, near, **same).disparity, phantom.truth)
    from_zero = rmse(run(phantom, initial="zero", **same).disparity, phantom.truth)
    assert helped < 0.2 * from_zero


def test_without_an_upload_the_matcher_starts_the_method(phantom):
    result = run(phantom, preset="released")
    assert result.meta["initial"] == "sgbm"
    assert result.timings["initial"] > 0
    assert rmse(result.disparity, phantom.truth) < 3


def test_the_result_says_what_was_done(phantom, broken):
    result = run(phantom, broken, preset="released", gdr={"levels": 9})
    quality = result.quality
    assert result.meta["backend"] == "native"
    assert result.meta["preset"] == "released"
    assert result.meta["params"]["gdr"]["levels"] == 9
    assert quality["levels"] == 5  # 128, 64, 32, 16, 8 rows
    assert sum(quality[kind] for kind in ("kept", "refined", "filled", "unobserved")) == pytest.approx(1)
    assert quality["valid_in"] == pytest.approx(np.mean(broken > 0))
    assert quality["residual_after"] < quality["residual_before"]


def test_confidence_follows_the_error(phantom, broken):
    result = run(phantom, broken, stages=["ldr"])
    error = np.abs(broken - phantom.truth)
    known = broken > 0
    assert (
        result.input_confidence[known & (error < 0.5)].mean()
        > 2 * result.input_confidence[known & (error > 5)].mean()
    )
    assert (result.input_confidence[~known] == 0).all()


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (3, 300), (17, 33)])
@pytest.mark.parametrize("stages", [["ldr"], ["gdr"], ["ldr", "gdr"]])
@pytest.mark.parametrize("scale", [0.5, 1])
def test_every_size_gives_a_finite_result(size, stages, scale):
    rng = np.random.default_rng(9)
    left, right = rng.integers(0, 256, (2, *size, 3)).astype(np.uint8)
    result = refine(left, right, np.full(size, 0.5), stages=stages, processing_scale=scale)
    for plane in (result.disparity, result.confidence, result.input_confidence):
        assert plane.shape == size
        assert plane.dtype == np.float32
        assert np.isfinite(plane).all()
        assert (plane >= 0).all()


@pytest.mark.parametrize("level", [0, 7, 255])
def test_constant_images_give_back_a_smooth_map(level):
    image = np.full((40, 60, 3), level, np.uint8)
    result = refine(image, image, np.full((40, 60), 4.0))
    assert np.allclose(result.disparity, 4, atol=1e-3)


def test_unknown_values_never_come_through():
    rng = np.random.default_rng(1)
    left, right = rng.integers(0, 256, (2, 32, 48)).astype(np.uint8)
    disparity = np.full((32, 48), 5.0)
    disparity[::3], disparity[1::7], disparity[:, ::5], disparity[2, 2] = np.nan, np.inf, -3, 1e30
    for stages in (["ldr"], ["gdr"], ["ldr", "gdr"]):
        result = refine(left, right, disparity, stages=stages)
        assert np.isfinite(result.disparity).all()
        assert (result.disparity < 48).all()


def test_without_inliers_the_input_stays_and_a_warning_says_so():
    rng = np.random.default_rng(2)
    left, right = rng.integers(0, 256, (2, 32, 48, 3)).astype(np.uint8)
    disparity = rng.uniform(1, 40, (32, 48)).astype(np.float32)
    result = refine(left, right, disparity, stages=["ldr"], ldr={"min_confidence": 1.0})
    assert "no-inliers" in result.quality["warnings"]
    assert (result.disparity == disparity).all()


def test_a_grey_scene_is_refined_and_said_to_be_one(phantom, broken):
    grey = [image.mean(axis=2).astype(np.uint8) for image in (phantom.pair.left, phantom.pair.right)]
    result = refine(*grey, broken, preset="paper")
    assert result.quality["warnings"] == ["no-colour"]
    assert rmse(result.disparity, phantom.truth) < 0.6 * rmse(broken, phantom.truth)


IMAGE = np.zeros((10, 20), np.uint8)


@pytest.mark.parametrize(
    ("error", "named", "arguments"),
    [
        (NoValidDisparity, "no finite value above 0", (IMAGE, IMAGE, np.full((10, 20), np.nan))),
        (NoValidDisparity, "disparity_scale", (IMAGE, IMAGE, np.full((10, 20), 2560.0))),
        (NoValidDisparity, "matching found none", (IMAGE, IMAGE)),
        (ShapeMismatch, "20 x 9.*20 x 10", (IMAGE, IMAGE[:9])),
        (ShapeMismatch, "disparity is 19 x 10.*left is 20 x 10", (IMAGE, IMAGE, np.ones((10, 19)))),
        (UnknownFormat, "float64.*uint8 or uint16", (IMAGE / 2, IMAGE)),
        (UnknownFormat, r"\(10, 20, 3\).*\(H, W\)", (IMAGE, IMAGE, np.ones((10, 20, 3)))),
    ],
)
def test_unusable_arrays_are_named(error, named, arguments):
    with pytest.raises(error, match=named):
        refine(*arguments)


def test_contradictions_and_unknown_backends_are_refused():
    with pytest.raises(InvalidParameter, match="no disparity was sent"):
        refine(IMAGE, IMAGE, initial="upload")
    with pytest.raises(InvalidParameter, match="nothing to refine"):
        refine(IMAGE, IMAGE, initial="zero", stages=["ldr"])
    with pytest.raises(BackendUnavailable, match=r"'gpu'.*auto, cuda, native, reference"):
        refine(IMAGE, IMAGE, np.ones((10, 20)), backend="gpu")
