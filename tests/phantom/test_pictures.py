"""The two pictures show one scene: the same surface in both, highlights that move, different cameras."""

import numpy as np
import pytest

from stereomend.opencv import cv2
from stereomend.phantom.geometry import Frame, make_scene
from stereomend.phantom.rays import LEFT, RIGHT, Layer, Rig, Scene, Surface, frame_grid
from stereomend.phantom.render import Looks, Sensor, render_pair
from stereomend.phantom.scene import observe
from stereomend.phantom.shading import light_tissue, tissue_radiance
from stereomend.phantom.texture import Skin

SIZE = (320, 256)


@pytest.fixture(scope="module", params=[5, 11])
def world(request):
    scene = make_scene(np.random.default_rng(request.param), Frame.of(*SIZE, 20.0), False)
    truth, occluded, _ = observe(scene)
    matt, wet = (render_pair(scene, Looks(highlights=h), np.random.default_rng(9)) for h in (False, True))
    return truth, occluded, matt, wet


def to_left(image, disparity):
    y, x = np.mgrid[: disparity.shape[0], : disparity.shape[1]].astype(np.float32)
    return cv2.remap(image.astype(np.float32), x - disparity.astype(np.float32), y, cv2.INTER_CUBIC)


def visible(occluded):
    return cv2.erode((~occluded).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0


def test_the_right_picture_warped_by_the_truth_is_the_left_one(world):
    truth, occluded, (left, right), _ = world
    seen = visible(occluded)
    error = np.abs(to_left(right, truth) - left)[seen]
    assert error.mean() < 0.7
    assert np.quantile(error, 0.99) < 6


def test_half_a_pixel_of_error_shows_in_the_texture(world):
    truth, occluded, (left, right), _ = world
    seen = visible(occluded)
    right_error = np.abs(to_left(right, truth) - left)[seen].mean()
    for shift in (-0.5, 0.5):
        assert np.abs(to_left(right, truth + shift) - left)[seen].mean() > 2 * right_error


def overlap(left, right):
    return (left & right).sum() / (left | right).sum()


def test_highlights_are_white_and_move_over_the_surface_while_its_colours_stay(world):
    truth, occluded, matt, wet = world
    seen = visible(occluded)
    left, right = (image.min(axis=-1) for image in (wet[0], to_left(wet[1], truth)))
    assert ((left >= 230) & seen).sum() > 100
    assert overlap((left >= 230) & seen, (right >= 230) & seen) < 0.8
    left, right = (image.mean(axis=-1) for image in (matt[0], to_left(matt[1], truth)))
    bright = np.quantile(left[seen], 0.95)
    assert overlap((left > bright) & seen, (right > bright) & seen) > 0.88


def test_on_a_flat_film_the_highlight_lies_halfway_between_camera_and_light():
    rig, disparity = Rig(201, 151, 200.0, 4.5), 6.0
    grid = frame_grid(rig.width, rig.height, disparity)
    scene = Scene(rig, (Layer(Surface(grid, np.full(grid.shape, disparity))),))
    flat = np.zeros(grid.shape, np.float32)
    lit = light_tissue(scene, 0, Skin(np.zeros((*grid.shape, 3), np.float32), flat, flat + 1))
    depth = 200.0 * 4.5 / disparity
    for side, camera in ((LEFT, -2.25), (RIGHT, 2.25)):
        shine = tissue_radiance(lit, rig, side)[..., 0]
        weight = np.where(shine > 0.97 * shine.max(), shine, 0).astype(float)
        _, x = np.mgrid[: grid.height, : grid.width]
        centre_x = (weight * x).sum() / weight.sum() + grid.x0
        assert centre_x == pytest.approx(100 + 200 * (camera / 2) / depth, abs=0.3)


def test_gain_bias_and_noise_are_those_of_the_sensor():
    scene = make_scene(np.random.default_rng(4), Frame.of(160, 120, 10.0), False)

    def picture(right):
        return render_pair(scene, Looks(right=right), np.random.default_rng(3))[1].astype(float)

    plain = picture(Sensor())
    inner = (plain > 40) & (plain < 190)
    brighter = picture(Sensor(gain=(1.1, 1.0, 0.9), bias=3.0))
    for channel, gain in enumerate((1.1, 1.0, 0.9)):
        here = inner[..., channel]
        assert np.abs(brighter - (gain * plain + 3))[..., channel][here].max() <= 1.1
    noise = (picture(Sensor(noise=2.0)) - plain)[inner]
    assert noise.std() == pytest.approx(2, abs=0.15)
    assert abs(noise.mean()) < 0.1


def test_near_tissue_of_one_colour_is_brighter_than_far_tissue():
    rig = Rig(101, 81, 100.0, 4.5)
    grid = frame_grid(101, 81, 6.0)
    skin = Skin(
        np.ones((*grid.shape, 3), np.float32),
        np.zeros(grid.shape, np.float32),
        np.zeros(grid.shape, np.float32),
    )
    x, _ = grid.axes()
    tilted = Scene(rig, (Layer(Surface(grid, np.broadcast_to(4 + x / 50, grid.shape).copy())),))
    row = light_tissue(tilted, 0, skin).diffuse[grid.height // 2, :, 0]
    assert row[-grid.x0 + 70] > 1.1 * row[-grid.x0 + 30]
