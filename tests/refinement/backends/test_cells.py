"""Averages and planes on a coarse grid."""

import numpy as np
import pytest

from stereomend.refinement import select_backend
from stereomend.refinement.backends import CELL, BendRule, GroundRule, Polls
from stereomend.refinement.backends.reference_cells import (
    PlaneFit,
    Sums,
    blurred,
    fit_planes,
    pixels,
    ramp,
    ratio,
)

NATIVE, REFERENCE = select_backend("native", threads=2), select_backend("reference")
SIZES = [(1, 1), (1, 33), (33, 1), (5, 7), (61, 47), (200, 150)]


def means(values):
    """Cell by cell; those at the end have fewer pixels."""
    height, width = values.shape
    return np.array(
        [
            [values[y : y + CELL, x : x + CELL].astype(float).mean() for x in range(0, width, CELL)]
            for y in range(0, height, CELL)
        ]
    )


def back(cells, size):
    return pixels(cells, size)


@pytest.mark.parametrize("size", SIZES)
def test_a_constant_stays_one_through_cells_and_back(size):
    found = back(blurred(means(np.full(size, 3.5)), 20), size)
    assert found.shape == size
    assert np.allclose(found, 3.5)


def test_a_ramp_through_cells_and_back_stays_where_it_was():
    """Half-pixel centres: nothing moves, whether or not the cells cover the picture exactly."""
    for width in (160, 150):
        level = np.tile(np.arange(width, dtype=np.float32), (40, 1))
        for across in (level, np.ascontiguousarray(level.T)):
            error = np.abs(back(means(across), across.shape) - across)
            assert error[2 * CELL : -2 * CELL, 2 * CELL : -2 * CELL].max() < 0.1


@pytest.mark.parametrize("width", [1, 7, 8, 9, 64, 65, 149, 150])
def test_the_left_part_of_a_picture_is_that_of_the_whole(width):
    """Cells right of the part still count for its last pixels."""
    cells = np.random.default_rng(4).uniform(0, 9, (8, 19))
    whole = back(cells, (61, 150))
    assert np.allclose(back(cells, (61, width)), whole[:, :width], rtol=0, atol=1e-5)


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


def test_a_ramp_rises_between_its_ends_and_a_step_is_one_too():
    values = np.array([-1.0, 0.5, 0.625, 0.75, 2.0])
    assert ramp(values, 0.5, 0.75).tolist() == [0, 0, 0.5, 1, 1]
    assert ramp(values, 0.5, 0.5).tolist() == [0, 0, 1, 1, 1]


def plane(size, slope_x, slope_y):
    y, x = np.mgrid[: size[0], : size[1]]
    return (12 + slope_x * x + slope_y * y).astype(np.float32)


def fitted(u, known, width):
    """The plane around each pixel, by way of cells."""
    exact = np.where(known, u.astype(float), 0)
    cells = fit_planes(Sums(means(known), means(exact), means(exact**2)), width)
    return PlaneFit(*(back(found, u.shape) for found in cells))


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.05, 0.0), (-0.03, 0.02)])
@pytest.mark.parametrize("size", [(150, 200), (121, 187)])
def test_a_plane_is_found_again_where_nothing_of_it_is_known(size, slope):
    """Up to 20 px off its support; what holds slopes back along lines costs a few per cent of the change.

    Not in the outer half of the outermost cells, where nothing is interpolated.
    """
    truth = plane(size, *slope)
    known = np.broadcast_to(np.arange(size[1]) >= 40, size)
    given = np.where(known, truth, -50).astype(np.float32)
    fit = fitted(given, known, 25.0)
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
    assert fitted(noisy, np.ones(size, bool), 30.0).residual.mean() == pytest.approx(4, rel=0.15)


def test_without_any_known_pixel_there_is_no_support():
    fit = fitted(plane((40, 60), 0, 0), np.zeros((40, 60), bool), 10.0)
    assert not fit.support.any()
    assert np.isfinite(fit.value).all()
    assert np.isfinite(fit.residual).all()


@pytest.mark.parametrize("size", SIZES)
def test_planes_fit_pictures_of_any_size(size):
    fit = fitted(np.full(size, 6, np.float32), np.ones(size, bool), 9.0)
    for found in fit:
        assert found.shape == size
    assert np.allclose(fit.value, 6, atol=1e-3)
    assert np.allclose(fit.support, 1, atol=1e-5)


def polls_of(size, seed=2):
    """Votes as pictures have them: none at all in some places."""
    rng = np.random.default_rng(seed)
    shape = tuple(-(-side // CELL) for side in size)
    some = rng.random(shape) < 0.7
    voted, shown = rng.random(shape) * some, rng.random(shape)
    agreed, fair = voted * rng.random(shape), voted * rng.random(shape)
    lead, level = fair * rng.normal(0, 0.01, shape), fair * rng.random(shape)
    of_u = shown * rng.uniform(5, 60, shape)
    of_square = of_u**2 / np.maximum(shown, 1e-9) + shown * rng.random(shape)
    return Polls(voted, agreed, fair, lead, level, shown, of_u, of_square)


RULE = GroundRule(30, 24, 0.1, 0.62, 0.75, 0.008, 0.002)


@pytest.mark.parametrize("rule", [RULE, RULE._replace(trust=400, evidence=1)], ids=["usual", "far beyond"])
@pytest.mark.parametrize("size", SIZES)
def test_grounds_match_the_reference(size, rule):
    polls = polls_of(size)
    for found, expected in zip(
        NATIVE.ground(polls, size, rule), REFERENCE.ground(polls, size, rule), strict=True
    ):
        assert found.shape == size
        assert np.abs(found - expected).max() < 2e-6


@pytest.mark.parametrize("window", [4.0, 40.0, 900.0])
@pytest.mark.parametrize("size", SIZES)
def test_bent_maps_match_the_reference(size, window):
    u = np.random.default_rng(4).uniform(0, 1.2 * size[1], size).astype(np.float32)
    polls, rule = polls_of(size), BendRule(window, 0.1, 1.0)
    found, expected = NATIVE.bend(u, polls, rule), REFERENCE.bend(u, polls, rule)
    assert np.abs(found - expected).max() < 2e-5 * size[1] + 1e-5


def test_a_map_is_bent_only_where_its_match_lies_left_of_the_right_image():
    size = (40, 80)
    y, x = np.indices(size)
    truth = 20 + 0.1 * x + 0.05 * y
    u = np.where(x < truth, truth - 1, truth)
    polls = polls_of(size)._replace(
        shown=means(x >= truth), of_u=means((x >= truth) * truth), of_square=means((x >= truth) * truth**2)
    )
    for backend in (NATIVE, REFERENCE):
        bent = backend.bend(backend.plane(u), polls, BendRule(30.0, 0.1, 1.0))
        assert (bent[x >= u] == backend.plane(u)[x >= u]).all()
        # It was 1 px off; the ridge holds the slope back.
        assert np.abs(bent - truth)[x < u].max() < 0.6


@pytest.mark.parametrize("threads", [1, 3])
def test_grounds_are_bitwise_equal_for_any_number_of_threads(threads):
    size, polls, other = (200, 150), polls_of((200, 150)), select_backend("native", threads=threads)
    for found, expected in zip(
        other.ground(polls, size, RULE), NATIVE.ground(polls, size, RULE), strict=True
    ):
        assert (found == expected).all()
    u = np.full(size, 30, np.float32)
    rule = BendRule(30.0, 0.1, 1.0)
    assert (other.bend(u, polls, rule) == NATIVE.bend(u, polls, rule)).all()


def test_polls_of_another_picture_are_refused():
    with pytest.raises(ValueError, match="polls"):
        NATIVE.ground(polls_of((61, 47)), (61, 49), RULE)
