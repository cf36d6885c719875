"""Whole runs of `robust`: it mends what is broken and leaves alone what is good."""

from functools import cache

import numpy as np
import pytest

from stereomend import refine
from stereomend.disparity import Provenance
from stereomend.opencv import cv2
from stereomend.phantom import break_disparity, good_disparity, make_phantom

SEEDS = [311, 312]
MAPS = ("disparity", "confidence", "provenance", "input_confidence")
CASES = [(seed, instrument) for seed in SEEDS for instrument in (False, True)]


@cache
def phantom_of(seed, instrument):
    return make_phantom(seed, 320, 256, instrument=instrument)


@pytest.fixture(params=CASES, ids=lambda case: f"{case[0]}{'-instrument' * case[1]}")
def any_phantom(request):
    return phantom_of(*request.param)


def run(phantom, disparity=None, **params):
    return refine(phantom.pair.left, phantom.pair.right, disparity, **{"preset": "robust", **params})


def rmse(disparity, truth):
    return float(np.sqrt(np.mean((disparity.astype(float) - truth) ** 2)))


@pytest.fixture(scope="module")
def phantom():
    return phantom_of(312, True)


@pytest.fixture(scope="module")
def broken(phantom):
    return break_disparity(phantom, 312).values


def test_an_exact_map_comes_back(any_phantom):
    assert rmse(run(any_phantom, any_phantom.truth).disparity, any_phantom.truth) < 0.1


@pytest.mark.parametrize("kind", ["smooth", "blurred", "quantised"])
@pytest.mark.parametrize("instrument", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_good_map_is_not_made_worse(seed, instrument, kind):
    phantom = phantom_of(seed, instrument)
    good = good_disparity(phantom, seed, kind).values
    assert rmse(run(phantom, good).disparity, phantom.truth) <= 1.05 * rmse(good, phantom.truth)


@pytest.mark.parametrize(("seed", "instrument"), CASES)
def test_a_broken_map_improves_at_least_as_much_as_with_paper(seed, instrument):
    phantom = phantom_of(seed, instrument)
    broken = break_disparity(phantom, seed).values
    ours, printed = (
        rmse(run(phantom, broken, preset=p).disparity, phantom.truth) for p in ("robust", "paper")
    )
    assert ours <= printed
    assert ours < 0.15 * rmse(broken, phantom.truth)


def with_steps_of(px, phantom, disparity):
    return run(phantom, disparity, fusion={"step_px": px}).disparity


def test_the_steps_of_a_map_in_whole_pixels_are_no_jumps(any_phantom):
    whole = good_disparity(any_phantom, 7, "quantised").values
    assert (with_steps_of(0.2, any_phantom, whole) == with_steps_of(1, any_phantom, whole)).all()


def test_the_steps_of_a_map_in_nearly_whole_pixels_are(phantom):
    """Where nothing else leads across them, as it does on other phantoms."""
    uneven = good_disparity(phantom, 7, "quantised").values
    uneven[1::2] += np.float32(0.01)
    assert (with_steps_of(0.2, phantom, uneven) != with_steps_of(1, phantom, uneven)).any()


@pytest.mark.parametrize("seed", SEEDS)
def test_an_instrument_s_edge_has_at_most_half_of_the_bad_pixels_of_released(seed):
    phantom = phantom_of(seed, True)
    shaft, window = phantom.instrument.astype(np.uint8), np.ones((11, 11), np.uint8)
    edge = (cv2.dilate(shaft, window) > 0) & (cv2.erode(shaft, window) == 0)
    assert edge.mean() > 0.02
    broken = break_disparity(phantom, seed).values
    ours, released = (
        np.count_nonzero(np.abs(run(phantom, broken, preset=p).disparity - phantom.truth)[edge] > 3)
        for p in ("robust", "released")
    )
    assert released > 50
    assert ours <= released / 2


SAMPLED = [(y, x) for y in (0, 2, 3) for x in (0, 2, 3)]
"""Rows and columns, modulo 4, of the pixels that a sample is taken from at 0.75."""


def spiked(phantom, phases):
    """The truth with single wrong pixels, no two of them near each other, and where they are."""
    rng, (height, width) = np.random.default_rng(5), phantom.truth.shape
    spots = np.array([(y, x) for y in range(4, height - 4, 12) for x in range(4, width - 4, 12)])
    rows, columns = (spots + rng.choice(phases, len(spots))).T
    wrong, truth = phantom.truth.copy(), phantom.truth[rows, columns]
    off = rng.choice((-1, 1), rows.size) * rng.uniform(4, 25, rows.size)
    wrong[rows, columns] = np.where(truth + off > 0.6, truth + off, truth - off)
    return wrong, (rows, columns)


@pytest.mark.parametrize(
    "phases",
    [
        SAMPLED,
        [(y, x) for y in range(4) for x in range(4) if (y, x) not in SAMPLED],
    ],
    ids=["sampled", "between"],
)
def test_single_wrong_pixels_do_not_survive(any_phantom, phases):
    """On pixels that are sampled at working size or between them; at depth edges one may fit either side."""
    upload, spots = spiked(any_phantom, phases)
    refined, window = run(any_phantom, upload).disparity, np.ones((5, 5), np.uint8)
    flat = (cv2.dilate(any_phantom.truth, window) - cv2.erode(any_phantom.truth, window))[spots] < 1
    assert np.mean(np.abs(refined - any_phantom.truth)[spots][flat] < 1) > 0.98
    assert np.count_nonzero(np.abs(refined - upload)[spots][flat] < 2) == 0


def test_what_is_kept_is_the_upload_and_said_to_be(any_phantom):
    result = run(any_phantom, any_phantom.truth)
    same = result.disparity == any_phantom.truth
    assert same.mean() > 0.5
    assert np.isin(result.provenance[same], (Provenance.KEPT, Provenance.UNOBSERVED)).mean() > 0.999
    kept = result.provenance == Provenance.KEPT
    assert kept.mean() > 0.9
    assert np.abs(result.disparity - any_phantom.truth)[kept].max() <= 0.5
    assert (result.provenance[np.abs(result.disparity - any_phantom.truth) > 0.5] > Provenance.KEPT).all()


def test_holes_of_the_upload_are_filled_and_said_to_be(phantom):
    holed = phantom.truth.copy()
    holed[40:60, 100:130], holed[::17, ::13] = np.nan, 0
    hole = ~(holed > 0)
    result = run(phantom, holed)
    assert np.isin(result.provenance[hole], (Provenance.FILLED, Provenance.UNOBSERVED)).all()
    assert (result.provenance[hole] == Provenance.FILLED).mean() > 0.8
    assert rmse(result.disparity[hole], phantom.truth[hole]) < 0.5
    assert (result.input_confidence[hole] == 0).all()


def rim(shape):
    y, x = np.mgrid[: shape[0], : shape[1]]
    return (x - shape[1] / 2) ** 2 + (y - shape[0] / 2) ** 2 < (0.52 * min(shape)) ** 2


@pytest.fixture(scope="module")
def mask(phantom):
    return rim(phantom.truth.shape)


@pytest.fixture(scope="module")
def views(phantom, mask):
    """Both images as an endoscope shows them: a round picture in a dark rim that does not move."""
    return [
        np.where(mask[..., None], image, np.uint8(3)) for image in (phantom.pair.left, phantom.pair.right)
    ]


def test_a_dark_rim_does_less_harm_when_it_is_masked(phantom, views, broken, mask):
    nonsense = np.random.default_rng(0).uniform(1, 30, mask.shape)
    upload = np.where(mask, broken, nonsense).astype(np.float32)
    masked, whole = (
        rmse(refine(*views, upload, mask=chosen, preset="robust").disparity[mask], phantom.truth[mask])
        for chosen in (mask, None)
    )
    assert masked <= whole
    assert masked < 0.15 * rmse(broken[mask], phantom.truth[mask])


def test_what_is_masked_out_is_unobserved(views, broken, mask):
    result = refine(*views, np.where(mask, broken, 17).astype(np.float32), mask=mask, preset="robust")
    assert (result.provenance[~mask] == Provenance.UNOBSERVED).all()
    assert (result.confidence[~mask] == 0).all()
    assert (result.confidence[mask] > 0.3).mean() > 0.5
    assert np.isfinite(result.disparity).all()


def test_an_upload_under_the_mask_does_not_matter(views, broken, mask):
    uploads = (np.where(mask, broken, other).astype(np.float32) for other in (17, np.nan))
    first, second = (refine(*views, upload, mask=mask, preset="robust") for upload in uploads)
    for name in MAPS:
        assert (getattr(first, name) == getattr(second, name)).all(), name


@pytest.mark.parametrize("unknown", [0.0, -3.0, np.inf, 1e30, 400.0])
def test_all_ways_to_say_unknown_mean_the_same(phantom, broken, unknown):
    hole = np.zeros(broken.shape, bool)
    hole[100:130, 60:110], hole[::9, ::7] = True, True
    uploads = (np.where(hole, value, broken).astype(np.float32) for value in (np.nan, unknown))
    first, second = (run(phantom, upload) for upload in uploads)
    for name in MAPS:
        assert (getattr(first, name) == getattr(second, name)).all(), name


@pytest.mark.parametrize("axes", [2, 3])
def test_a_grey_pair_is_mended_too(phantom, broken, axes):
    grey = [image.mean(axis=2).astype(np.uint8) for image in (phantom.pair.left, phantom.pair.right)]
    if axes == 3:
        grey = [np.repeat(image[..., None], 3, axis=2) for image in grey]
    refined = refine(*grey, broken, preset="robust").disparity
    assert rmse(refined, phantom.truth) < 0.2 * rmse(broken, phantom.truth)


def test_sixteen_bit_images_give_what_eight_bit_ones_give(phantom, broken):
    deep = [image.astype(np.uint16) * 257 for image in (phantom.pair.left, phantom.pair.right)]
    difference = np.abs(refine(*deep, broken, preset="robust").disparity - run(phantom, broken).disparity)
    assert np.mean(difference < 0.01) > 0.99


def test_the_local_stage_alone_keeps_inliers_bit_for_bit(phantom, broken):
    result = run(phantom, broken, stages=["ldr"])
    kept = result.provenance == Provenance.KEPT
    assert 0.3 < kept.mean() < 0.99
    assert (result.disparity[kept] == broken[kept]).all()
    assert rmse(result.disparity, phantom.truth) < 0.6 * rmse(broken, phantom.truth)


@pytest.mark.parametrize("start", ["sgbm", "zero"])
def test_nothing_needs_to_be_uploaded(phantom, start):
    result = run(phantom, initial=start)
    assert result.meta["initial"] == start
    assert rmse(result.disparity, phantom.truth) < 1.5
    assert np.isfinite(result.disparity).all()


@pytest.mark.parametrize("backend", ["native", "reference"])
@pytest.mark.parametrize("stages", [["ldr"], ["gdr"], ["ldr", "gdr"]])
@pytest.mark.parametrize("size", [(1, 1), (8, 8), (1, 40), (40, 1), (33, 1), (3, 300), (17, 33)])
def test_every_size_gives_a_finite_result(size, stages, backend):
    left, right = np.random.default_rng(9).integers(0, 256, (2, *size, 3)).astype(np.uint8)
    result = refine(left, right, np.full(size, 0.7), preset="robust", stages=stages, backend=backend)
    for plane in (result.disparity, result.confidence, result.input_confidence):
        assert plane.shape == size
        assert plane.dtype == np.float32
        assert np.isfinite(plane).all()
        assert (plane >= 0).all()


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (17, 33)])
def test_a_single_pixel_of_scene_gives_a_finite_result(size):
    images = np.random.default_rng(9).integers(0, 256, (2, *size)).astype(np.uint8)
    mask = np.zeros(size, np.uint8)
    mask[size[0] // 2, size[1] // 2] = 1
    result = refine(*images, np.full(size, 0.7), mask=mask, preset="robust")
    assert np.isfinite(result.disparity).all()
    assert (result.confidence[mask == 0] == 0).all()


@pytest.mark.parametrize("level", [0, 7, 255])
def test_constant_images_give_back_a_smooth_map(level):
    image = np.full((40, 60, 3), level, np.uint8)
    assert np.allclose(refine(image, image, np.full((40, 60), 4.0), preset="robust").disparity, 4, atol=0.02)


@pytest.mark.parametrize("scale", [0.5, 0.75, 1])
def test_every_working_size_keeps_an_exact_map_and_mends_a_broken_one(phantom, broken, scale):
    exact = run(phantom, phantom.truth, processing_scale=scale).disparity
    assert rmse(exact, phantom.truth) < 0.15
    mended = run(phantom, broken, processing_scale=scale).disparity
    assert rmse(mended, phantom.truth) < 0.15 * rmse(broken, phantom.truth)


def test_results_are_bitwise_equal_for_any_number_of_threads(phantom, broken):
    results = [run(phantom, broken, threads=threads) for threads in (1, 2, 5)]
    for name in MAPS:
        assert len({getattr(result, name).tobytes() for result in results}) == 1, name


def test_the_choice_can_be_turned_off(phantom):
    """Then an exact map comes back as GDR sees it, nowhere bit for bit."""
    refined = run(phantom, phantom.truth, fusion={"enabled": False})
    assert np.mean(refined.disparity == phantom.truth) < 0.01
    assert np.mean(run(phantom, phantom.truth).disparity == phantom.truth) > 0.5


def test_whole_runs_stay_near_the_reference(phantom, broken):
    """Near, and not equal: each choice has thresholds, and a rounding may tip one."""
    part = np.s_[40:168, 60:220]
    images = [image[part] for image in (phantom.pair.left, phantom.pair.right)]
    maps = [
        refine(*images, broken[part], preset="robust", backend=name).disparity.astype(float)
        for name in ("native", "reference")
    ]
    error = np.abs(maps[0] - maps[1])
    assert np.mean(error <= 0.01) >= 0.99
    assert np.mean(error <= 0.05) >= 0.997
