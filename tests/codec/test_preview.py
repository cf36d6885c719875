from __future__ import annotations

import numpy as np
import pytest

from stereomend.codec import colourise, preview_picture

# The ends and the middle of viridis, as matplotlib publishes it.
VIOLET, TEAL, YELLOW = (68, 1, 84), (33, 145, 140), (253, 231, 37)


def luma(picture: np.ndarray) -> np.ndarray:
    return picture.astype(float) @ (0.2126, 0.7152, 0.0722)


@pytest.mark.parametrize("shape", [(1, 1), (1, 13), (13, 1), (37, 53)])
def test_a_picture_has_the_shape_of_its_map(random, shape):
    picture = colourise(random.random(shape, np.float32) + 1)
    assert picture.shape == (*shape, 3)
    assert picture.dtype == np.uint8


def test_far_is_violet_near_is_yellow_and_brightness_grows_in_between():
    picture = colourise(np.linspace(10, 50, 512, dtype=np.float32)[None, :])
    np.testing.assert_allclose(picture[0, 0], VIOLET, atol=3)
    np.testing.assert_allclose(picture[0, 256], TEAL, atol=3)
    np.testing.assert_allclose(picture[0, -1], YELLOW, atol=3)
    assert (np.diff(luma(picture[0, 8:-8])) > -1).all()


def test_outliers_do_not_flatten_the_colours_of_the_rest():
    disparity = np.tile(np.linspace(10, 50, 512, dtype=np.float32), (20, 1))
    sound = colourise(disparity)
    disparity[0, :20] = 1e38
    disparity[1, :20] = 1e-38
    np.testing.assert_allclose(luma(colourise(disparity))[2:], luma(sound)[2:], atol=4)


def test_what_is_unknown_is_black_and_counts_for_nothing():
    disparity = np.linspace(10, 50, 512, dtype=np.float32)[None, :].repeat(5, axis=0)
    sound = colourise(disparity[1:])
    disparity[0, :4] = 0, -5, np.nan, np.inf
    disparity[0, 4:] = np.nan
    picture = colourise(disparity)
    assert not picture[0].any()
    np.testing.assert_array_equal(picture[1:], sound)


@pytest.mark.parametrize("value", [0.0, np.nan, 7.5, 1e38])
def test_flat_and_unknown_maps_are_one_colour(value):
    picture = colourise(np.full((5, 7), value, np.float32))
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) == 1


@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1), (480, 640), (97, 1000)])
def test_the_bar_stands_at_the_right_of_the_untouched_map(random, shape):
    disparity = random.random(shape, np.float32) * 30 + 5
    picture = preview_picture(disparity)
    height, width = shape
    assert picture.shape[0] == max(height, 96)
    np.testing.assert_array_equal(picture[:height, :width], colourise(disparity))
    assert not picture[height:, :width].any()


def test_the_bar_runs_from_near_at_the_top_to_far_at_the_bottom_with_numbers_beside_it():
    disparity = np.linspace(10, 50, 480 * 640, dtype=np.float32).reshape(480, 640)
    bar = preview_picture(disparity)[:, 640:]
    column = next(column for column in bar.transpose(1, 0, 2) if column.any())
    painted = column[column.any(axis=1)]
    np.testing.assert_allclose(painted[0], YELLOW, atol=3)
    np.testing.assert_allclose(painted[-1], VIOLET, atol=3)
    assert len(painted) > 400
    white = (bar == 255).all(axis=2)
    for place in (slice(0, 40), slice(220, 260), slice(440, 480)):
        assert white[place].any()
    assert not bar[:, -1].any()
    assert not white[[0, -1]].any()


@pytest.mark.parametrize("width", [4, 5, 6])
def test_large_maps_are_coloured_by_a_sample_that_meets_all_columns(width):
    columns = np.linspace(10, 50, width, dtype=np.float32)
    picture = colourise(np.tile(columns, (1_200_000 // width, 1)))
    np.testing.assert_array_equal(picture[:1], colourise(columns[None, :].repeat(200, axis=0))[:1])
    assert (np.diff(luma(picture[0])) > 0).all()
