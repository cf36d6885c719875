"""The truth against a scalar ray marcher that works in space."""

import sys
from pathlib import Path

import numpy as np
import pytest

from stereomend.opencv import cv2
from stereomend.phantom.geometry import Frame, make_scene
from stereomend.phantom.rays import LEFT, RIGHT, SHAFT, Surface, cast, first_crossing
from stereomend.phantom.scene import observe
from stereomend.phantom.spline import Grid, smooth_noise

sys.path.insert(0, str(Path(__file__).parent))
from ray_oracle import Space, value

SIZE = (210, 161)


@pytest.fixture(scope="module", params=[(1, True), (6, False), (7, True)], ids=str)
def world(request):
    seed, instrument = request.param
    scene = make_scene(np.random.default_rng(seed), Frame.of(*SIZE, 30.0), instrument)
    return scene, Space(scene), observe(scene)


def some_pixels(rng, mask, count):
    rows, columns = np.nonzero(mask)
    chosen = rng.permutation(rows.size)[:count]
    return list(zip(rows[chosen].tolist(), columns[chosen].tolist(), strict=True))


def near_edges(mask):
    mask = mask.astype(np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    return cv2.dilate(mask, kernel) != cv2.erode(mask, kernel)


def test_the_first_point_on_a_left_ray_projects_to_x_minus_d_in_the_right_image(world):
    scene, space, (truth, _, shown) = world
    half = scene.rig.baseline_mm / 2
    rng = np.random.default_rng(0)
    everywhere = np.ones(truth.shape, bool)
    pixels = some_pixels(rng, everywhere, 60) + some_pixels(rng, shown | near_edges(shown), 25)
    for row, column in pixels:
        ray = space.ray(column, row, 1)
        point = ray(space.first_depth(ray, 31.0, 5.0))
        x, y = space.project(point, half)
        assert y == pytest.approx(row, abs=1e-6)
        assert x == pytest.approx(column - truth[row, column], abs=1e-3)


def test_occluded_are_the_points_whose_way_to_the_right_camera_is_blocked(world):
    scene, space, (truth, occluded, _) = world
    columns = np.arange(SIZE[0])[None, :]
    inside = columns - truth >= 0
    assert occluded[~inside].all()
    rng = np.random.default_rng(1)
    pixels = some_pixels(rng, inside & occluded, 30) + some_pixels(rng, inside & ~occluded, 30)
    pixels += some_pixels(rng, inside & near_edges(occluded), 30)
    scale = scene.rig.focal_px * scene.rig.baseline_mm
    for row, column in pixels:
        disparity = truth[row, column]
        right = space.ray(column - disparity, row, -1)
        blocker = space.first_depth(right, 31.0, disparity + 2e-3)
        assert (blocker is not None) == occluded[row, column], (
            row,
            column,
            blocker and scale / blocker,
            disparity,
        )


def test_what_the_right_camera_sees_of_a_visible_pixel_is_the_same_surface(world):
    scene, _, (truth, occluded, shown) = world
    y = np.arange(SIZE[1], dtype=float)
    x = np.arange(SIZE[0]) - truth
    seen = cast(scene, y, x.clip(0), -1)
    visible = ~occluded
    assert np.abs(seen.disparity - truth)[visible].max() <= 1e-3
    assert np.array_equal((seen.surface == SHAFT)[visible], shown[visible])


def test_occlusion_agrees_with_a_z_buffer_of_the_disparities_apart_from_edges(world):
    _, _, (truth, occluded, _) = world
    match = np.arange(SIZE[0]) - truth
    from_the_right = np.minimum.accumulate(match[:, ::-1], axis=1)[:, ::-1]
    behind = np.zeros(truth.shape, bool)
    behind[:, :-1] = from_the_right[:, 1:] <= match[:, :-1]
    inner = ~near_edges(occluded) & ~near_edges(behind)
    # What hides a point at the right edge may itself lie beyond the left picture.
    inner &= np.arange(SIZE[0]) + 30 - truth < SIZE[0]
    assert np.array_equal((behind | (match < 0))[inner], occluded[inner])


def test_occlusions_inside_the_frame_exist(world):
    _, _, (truth, occluded, _) = world
    inside = np.arange(SIZE[0])[None, :] - truth >= 0
    assert (occluded & inside).sum() > 50


def test_a_surface_is_the_spline_of_its_control_points():
    rng = np.random.default_rng(5)
    surface = Surface(Grid(-4, -3, 17, 12), rng.normal(size=(12, 17)))
    x, y = rng.uniform(-3, 10, (6, 5)), rng.uniform(-2, 6, 6)
    expected = [[value(surface, x[i, j], y[i]) for j in range(5)] for i in range(6)]
    assert np.allclose(surface.at(x, y), expected, atol=1e-12)
    knots = surface.at_knots()
    assert knots[5, 6] == pytest.approx(value(surface, 2, 2), abs=1e-12)


@pytest.mark.parametrize("side", [LEFT, RIGHT])
def test_of_the_points_of_a_steep_sheet_on_one_ray_the_nearest_is_met(side):
    rng = np.random.default_rng(8)
    grid = Grid(-20, -3, 100, 8)
    surface = Surface(
        grid, np.broadcast_to(14 + 10 * rng.uniform(-1, 1, 100).repeat(5)[:100], grid.shape).copy()
    )
    x = rng.uniform(0, 55, (1, 150))
    met = first_crossing(surface, np.array([1.0]), x, side)[0]
    dense = np.arange(-18, 77, 0.01)
    disparity = surface.at(dense[None, :], np.array([1.0]))[0]
    several = 0
    for column, found in zip(x[0], met, strict=True):
        ahead = dense + side * disparity / 2 > column
        crossings = np.nonzero(ahead[1:] != ahead[:-1])[0]
        several += crossings.size > 1
        assert found == pytest.approx(dense[crossings[0 if side == LEFT else -1]], abs=0.011)
    assert several > 8


def test_noise_has_unit_variance_and_features_of_its_cell():
    noise = smooth_noise(np.random.default_rng(2), (600, 600), 6.0)
    assert noise.std() == pytest.approx(1, abs=0.05)
    assert abs(noise.mean()) < 0.05
    assert np.corrcoef(noise[:, :-3].ravel(), noise[:, 3:].ravel())[0, 1] > 0.6
    assert abs(np.corrcoef(noise[:, :-24].ravel(), noise[:, 24:].ravel())[0, 1]) < 0.05
