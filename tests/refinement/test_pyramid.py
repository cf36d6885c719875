import numpy as np
import pytest

from stereomend.disparity import DisparityMap
from stereomend.refinement import select_backend
from stereomend.refinement.pyramid import (
    Sparse,
    as_sparse,
    enlarge_disparity,
    enlarge_mask,
    level_sizes,
    working_size,
)
from stereomend.refinement.stage_params import GdrParams

BACKENDS = ["native", "reference"]


@pytest.fixture(params=BACKENDS)
def backend(request):
    return select_backend(request.param, threads=2)


def area_mean(image, size):
    """Brute force: repeat every pixel so often that the larger ones consist of whole copies."""
    height, width = image.shape
    fine = np.repeat(np.repeat(image, size[0], axis=0), size[1], axis=1)
    return fine.reshape(size[0], height, size[1], width).mean(axis=(1, 3))


@pytest.mark.parametrize(
    ("shape", "size"), [((1, 1), (1, 1)), ((3, 5), (2, 3)), ((9, 31), (5, 16)), ((8, 8), (4, 4))]
)
def test_images_shrink_by_the_area_mean(shape, size, backend):
    image = np.random.default_rng(1).uniform(0, 255, shape)
    assert np.allclose(backend.shrink(backend.plane(image), size), area_mean(image, size), atol=1e-4)


@pytest.mark.parametrize(("side", "half"), [(64, 32), (63, 32), (631, 316)])
def test_shrinking_and_enlarging_keep_pixel_centres(side, half, backend):
    """A ramp over the width keeps its values at the same places of the scene, to a fiftieth of a pixel."""

    def ramp(n):
        return np.tile((np.arange(n) + 0.5) / n, (9, 1))

    shrunk = backend.shrink(backend.plane(ramp(side)), (9, half))
    assert np.allclose(shrunk, ramp(half), atol=0.02 / side)
    enlarged = backend.enlarge(backend.plane(ramp(half)), (9, side))
    assert np.allclose(enlarged[:, 1:-1], ramp(side)[:, 1:-1], atol=0.02 / side)


def test_disparity_scales_with_the_width(backend):
    sparse = Sparse(backend.plane(np.full((10, 30), 12.0)), np.ones((10, 30), bool))
    assert np.allclose(backend.shrink_sparse(sparse, (5, 15)).u, 6)
    assert np.allclose(backend.shrink_sparse(sparse, (5, 20)).u, 8)
    assert np.allclose(enlarge_disparity(backend.plane(np.full((5, 15), 6.0)), (10, 30), backend), 12)


def test_disparity_is_averaged_over_valid_pixels_only(backend):
    u = backend.plane([[8, 0, 0, 0, 4, 0], [4, 0, 0, 2, 4, 4]])
    shrunk = backend.shrink_sparse(Sparse(u, u > 0), (1, 3))
    assert shrunk.valid.tolist() == [[True, False, True]]
    assert shrunk.u == pytest.approx(np.array([[3, 0, 2]]))


def test_levels_halve_rounding_up_and_stop_before_eight_pixels():
    assert level_sizes((63, 100), GdrParams(levels=4)) == [(63, 100), (32, 50), (16, 25), (8, 13)]
    assert level_sizes((63, 100), GdrParams(levels=9)) == [(63, 100), (32, 50), (16, 25), (8, 13)]
    assert level_sizes((63, 100), GdrParams(levels=3)) == [(63, 100), (32, 50), (16, 25)]
    assert level_sizes((15, 400), GdrParams(levels=4)) == [(15, 400), (8, 200)]
    assert level_sizes((1, 1), GdrParams(levels=4)) == [(1, 1)]


def test_the_least_side_of_a_level_can_be_chosen():
    assert level_sizes((63, 100), GdrParams(levels=9, least_side_px=16)) == [(63, 100), (32, 50), (16, 25)]
    assert level_sizes((63, 100), GdrParams(levels=9, least_side_px=17)) == [(63, 100), (32, 50)]
    assert level_sizes((63, 100), GdrParams(levels=9, least_side_px=64)) == [(63, 100)]
    # Rounded up, a side never falls below 1 px: the number of levels alone bounds them then.
    assert len(level_sizes((63, 100), GdrParams(levels=9, least_side_px=1))) == 9


def test_the_working_size_is_never_empty():
    assert working_size((1, 1), 0.5) == (1, 1)
    assert working_size((576, 720), 0.5) == (288, 360)
    assert working_size((3, 2000), 0.1) == (1, 200)


def test_masks_grow_by_the_pixel_under_each_centre():
    mask = np.array([[True, False, True]])
    assert enlarge_mask(mask, (2, 6)).tolist() == [[True, True, False, False, True, True]] * 2
    assert enlarge_mask(mask, (1, 5)).tolist() == [[True, True, False, True, True]]


def test_what_reaches_beyond_the_image_counts_as_unknown():
    sparse = as_sparse(DisparityMap.from_array(np.array([[1.0, 2.5, 3.0, np.nan]])[:, :3]))
    assert sparse.valid.tolist() == [[True, True, False]]
