"""What is not part of the scene has no say in what is."""

import numpy as np
import pytest

from stereomend import refine
from stereomend.disparity import Provenance
from stereomend.errors import InvalidParameter, NoValidDisparity, ShapeMismatch, UnknownFormat
from stereomend.phantom import break_disparity, make_phantom

RIM = 3  # grey level of the dark rim
MAPS = ("disparity", "confidence", "provenance", "input_confidence")


def disc(shape):
    y, x = np.mgrid[: shape[0], : shape[1]]
    return (x - shape[1] / 2) ** 2 + (y - shape[0] / 2) ** 2 < (0.52 * min(shape)) ** 2


@pytest.fixture(scope="module")
def phantom():
    return make_phantom(0, 320, 256)


@pytest.fixture(scope="module")
def mask(phantom):
    return disc(phantom.truth.shape)


@pytest.fixture(scope="module")
def views(phantom, mask):
    """Both images as an endoscope shows them: a round picture in a dark rim that does not move."""
    return [
        np.where(mask[..., None], image, np.uint8(RIM)) for image in (phantom.pair.left, phantom.pair.right)
    ]


@pytest.fixture(scope="module")
def broken(phantom, mask):
    """What a network gives, with nonsense in the rim."""
    nonsense = np.random.default_rng(0).uniform(1, 30, mask.shape)
    return np.where(mask, break_disparity(phantom, 0).values, nonsense).astype(np.float32)


def rmse_inside(result, phantom, mask):
    return float(np.sqrt(np.mean((result.disparity[mask].astype(float) - phantom.truth[mask]) ** 2)))


@pytest.mark.parametrize("preset", ["paper", "released"])
def test_a_dark_rim_does_less_harm_when_it_is_masked(phantom, views, broken, mask, preset):
    masked, whole = (
        rmse_inside(refine(*views, broken, mask=chosen, preset=preset), phantom, mask)
        for chosen in (mask, None)
    )
    assert masked < 0.9 * whole


def test_what_is_masked_out_is_inferred_and_said_to_be(views, broken, mask):
    result = refine(*views, broken, mask=mask, preset="released", focal_px=300, baseline_mm=4)
    assert np.isfinite(result.disparity).all()
    assert (result.provenance[~mask] == Provenance.UNOBSERVED).all()
    for plane in (result.confidence, result.input_confidence, result.depth_mm):
        assert (plane[~mask] == 0).all()
        assert (plane[mask] > 0).mean() > 0.5
    assert result.quality["valid_in"] == pytest.approx(np.mean((broken > 0) & mask))
    assert result.quality["unobserved"] >= np.mean(~mask)


@pytest.mark.parametrize("backend", ["native", "reference"])
@pytest.mark.parametrize("stages", [["ldr"], ["gdr"], ["ldr", "gdr"]])
def test_an_upload_under_the_mask_does_not_matter(views, broken, mask, backend, stages):
    other = np.where(mask, broken, np.nan)
    left, right = (image[:128, :160] for image in views)
    corner = np.s_[:128, :160]
    results = [
        refine(
            *(left, right, upload[corner]),
            mask=mask[corner],
            backend=backend,
            stages=stages,
            gdr={"warps": 2},
        )
        for upload in (broken, other)
    ]
    for name in MAPS:
        assert (getattr(results[0], name) == getattr(results[1], name)).all(), name


def test_a_mask_that_leaves_everything_changes_nothing(views, broken):
    """Any number but 0 is scene, and the weights are 1 up to rounding."""
    everything = np.random.default_rng(1).integers(1, 65536, broken.shape).astype(np.uint16)
    masked, whole = (refine(*views, broken, mask=chosen, preset="released") for chosen in (everything, None))
    assert np.mean(np.abs(masked.disparity - whole.disparity) < 1e-3) > 0.999
    assert np.mean(masked.provenance != whole.provenance) < 0.001


def test_masked_runs_match_the_reference(views, broken, mask):
    maps = [
        refine(*views, broken, mask=mask, preset="released", backend=name).disparity
        for name in ("native", "reference")
    ]
    error = np.abs(maps[0].astype(float) - maps[1])
    assert np.mean(error <= 0.01) >= 0.999


def test_without_an_upload_the_matcher_starts_from_the_scene_only(phantom, views, mask):
    result = refine(*views, mask=mask, preset="released")
    assert result.meta["initial"] == "sgbm"
    assert (result.input_confidence[~mask] == 0).all()
    assert result.quality["valid_in"] < mask.mean()
    assert rmse_inside(result, phantom, mask) < 3


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (17, 33)])
@pytest.mark.parametrize("scale", [0.5, 1])
def test_a_single_pixel_of_scene_gives_a_finite_result(size, scale):
    images = np.random.default_rng(9).integers(0, 256, (2, *size)).astype(np.uint8)
    mask = np.zeros(size, np.uint8)
    mask[size[0] // 2, size[1] // 2] = 1
    result = refine(*images, np.full(size, 0.5), mask=mask, processing_scale=scale)
    assert np.isfinite(result.disparity).all()
    assert (result.confidence[mask == 0] == 0).all()


IMAGE = np.zeros((10, 20), np.uint8)
HALF = np.arange(20) < np.full((10, 1), 10)


@pytest.mark.parametrize(
    ("error", "named", "disparity", "mask"),
    [
        (InvalidParameter, "mask is 0 everywhere", np.ones((10, 20)), np.zeros((10, 20), bool)),
        (ShapeMismatch, "mask is 20 x 9.*left is 20 x 10", np.ones((10, 20)), np.ones((9, 20), bool)),
        (UnknownFormat, "mask is float64", np.ones((10, 20)), np.ones((10, 20))),
        (UnknownFormat, r"mask is uint8 of shape \(10, 20, 3\)", None, np.ones((10, 20, 3), np.uint8)),
        (NoValidDisparity, "the mask", np.where(HALF, 3.0, 0), ~HALF),
    ],
)
def test_masks_that_do_not_fit_are_named(error, named, disparity, mask):
    with pytest.raises(error, match=named):
        refine(IMAGE, IMAGE, disparity, mask=mask)
