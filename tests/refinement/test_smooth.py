"""Averages and planes on a coarse grid."""

import numpy as np
import pytest

from stereomend.refinement import select_backend
from stereomend.refinement.smooth import CELL, Grid, blurred, fit_planes, ratio

NATIVE = select_backend("native", threads=2)
SIZES = [(1, 1), (1, 33), (33, 1), (5, 7), (61, 47), (200, 150)]


@pytest.mark.parametrize("size", SIZES)
def test_a_constant_stays_one_through_cells_and_back(size):
    grid = Grid(size, NATIVE)
    cells = grid.cells(np.full(size, 3.5, np.float32))
    assert np.allclose(cells, 3.5)
    back = grid.pixels(blurred(cells, 20))
    assert back.shape == size
    assert np.allclose(back, 3.5)


def test_cells_are_means():
    values = np.random.default_rng(1).uniform(0, 9, (4 * CELL, 6 * CELL)).astype(np.float32)
    expected = values.reshape(4, CELL, 6, CELL).mean(axis=(1, 3))
    assert np.allclose(Grid(values.shape, NATIVE).cells(values), expected, atol=1e-5)


def test_a_ramp_through_cells_and_back_stays_where_it_was():
    """Half-pixel centres: nothing moves, whether or not the cells cover the picture exactly."""
    for width in (160, 150):
        ramp = np.tile(np.arange(width, dtype=np.float32), (40, 1))
        grid = Grid(ramp.shape, NATIVE)
        back = grid.pixels(grid.cells(ramp))
        assert np.abs(back - ramp)[:, 2 * CELL : -2 * CELL].max() < 0.1


@pytest.mark.parametrize("width", [8.0, 24.0])
def test_blurring_is_a_gaussian_that_keeps_sums_and_stops_at_no_border(width):
    cells = np.zeros((41, 43))
    cells[20, 21] = 1
    spread = blurred(cells, width)
    place = np.arange(43) - 21
    assert spread.sum() == pytest.approx(1)
    assert np.sqrt((spread.sum(axis=0) * place**2).sum()) == pytest.approx(width / CELL, rel=0.05)
    uneven = np.random.default_rng(2).random((5, 7))
    assert blurred(uneven, 30.0).sum() == pytest.approx(uneven.sum())


def test_the_ratio_of_nothing_to_nothing_is_0():
    found = ratio(np.array([0.0, 1.0, 3.0, 1e-9]), np.array([0.0, 0.0, 4.0, 1e-9]))
    assert found.tolist() == [0, 0, 0.75, 0]


def plane(size, slope_x, slope_y):
    y, x = np.mgrid[: size[0], : size[1]]
    return (12 + slope_x * x + slope_y * y).astype(np.float32)


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.05, 0.0), (-0.03, 0.02)])
@pytest.mark.parametrize("size", [(150, 200), (121, 187)])
def test_a_plane_is_found_again_where_nothing_of_it_is_known(size, slope):
    """Up to 20 px off its support; what holds slopes back along lines costs a few per cent of the change.

    Not in the outer half of the outermost cells, where nothing is interpolated.
    """
    truth = plane(size, *slope)
    known = np.arange(size[1]) >= 40
    given = np.where(known, truth, -50).astype(np.float32)
    fit = fit_planes(given, np.broadcast_to(known, size).copy(), 25.0, Grid(size, NATIVE))
    error = np.abs(fit.value - truth)[CELL:-CELL, :-CELL]
    change = 25 * np.hypot(*slope)
    assert error[:, 60:].max() < 0.05 + 0.06 * change
    assert error[:, 20:60].max() < 0.05 + 0.4 * change
    assert fit.residual[:, 20:].max() < 0.01 + 0.06 * change**2
    assert (fit.support[:, 60:] > 0.7).all()
    assert (fit.support[:, :10] < fit.support[:, 60:].min()).all()


def test_the_residual_is_what_no_plane_explains():
    size, rng = (160, 160), np.random.default_rng(3)
    noisy = plane(size, 0.02, 0.01) + rng.normal(0, 2, size).astype(np.float32)
    fit = fit_planes(noisy, np.ones(size, bool), 30.0, Grid(size, NATIVE))
    assert fit.residual.mean() == pytest.approx(4, rel=0.15)


def test_without_any_known_pixel_there_is_no_support():
    fit = fit_planes(plane((40, 60), 0, 0), np.zeros((40, 60), bool), 10.0, Grid((40, 60), NATIVE))
    assert not fit.support.any()
    assert np.isfinite(fit.value).all()
    assert np.isfinite(fit.residual).all()


@pytest.mark.parametrize("size", SIZES)
def test_planes_fit_pictures_of_any_size(size):
    fit = fit_planes(np.full(size, 6, np.float32), np.ones(size, bool), 9.0, Grid(size, NATIVE))
    for found in fit:
        assert found.shape == size
    assert np.allclose(fit.value, 6, atol=1e-3)
    assert np.allclose(fit.support, 1, atol=1e-5)
