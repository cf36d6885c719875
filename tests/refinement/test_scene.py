import numpy as np
import pytest

from stereomend.disparity import StereoPair
from stereomend.refinement import select_backend
from stereomend.refinement.backends import GlintRule
from stereomend.refinement.backends.sizes import area_weights
from stereomend.refinement.scene import make_scene, matte_mask
from stereomend.refinement.stage_params import LdrParams

NATIVE, REFERENCE = select_backend("native", threads=1), select_backend("reference")


def scene_of(image, size, params=None):
    return make_scene(StereoPair(image, image), size, params or LdrParams(), NATIVE)


def test_grey_levels_follow_bt601():
    image = np.zeros((2, 2, 3), np.uint8)
    image[0, 0], image[0, 1], image[1, 0] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    grey = scene_of(image, (2, 2)).left
    assert grey[0, 0] == pytest.approx(0.299 * 255, abs=1e-4)
    assert grey[0, 1] == pytest.approx(0.587 * 255, abs=1e-4)
    assert grey[1, 0] == pytest.approx(0.114 * 255, abs=1e-4)


@pytest.mark.parametrize("scale", [0.5, 0.75, 1])
def test_both_images_are_the_area_means_of_their_grey_levels(scale):
    rng = np.random.default_rng(3)
    left, right = rng.integers(0, 256, (2, 48, 64, 3), np.uint8)
    size = (round(48 * scale), round(64 * scale))
    scene = make_scene(StereoPair(left, right), size, LdrParams(), NATIVE)
    rows, columns = area_weights(48, size[0]), area_weights(64, size[1])
    for image, found in ((left, scene.left), (right, scene.right)):
        assert np.abs(rows @ (image @ (0.299, 0.587, 0.114)) @ columns.T - found).max() < 1e-4


def test_sixteen_bit_images_have_the_levels_of_eight_bit_ones():
    image = np.random.default_rng(0).integers(0, 256, (6, 8, 3)).astype(np.uint8)
    deep = image.astype(np.uint16) * 257
    assert np.allclose(scene_of(deep, (3, 4)).left, scene_of(image, (3, 4)).left, atol=1e-4)


def test_pale_pixels_of_a_colour_image_are_highlights():
    image = np.full((1, 3, 3), (120, 40, 40), np.uint8)
    image[0, 1] = (250, 245, 250)
    assert scene_of(image, (1, 3)).matte.tolist() == [[True, False, True]]


def test_a_dark_grey_pixel_is_no_highlight_when_brightness_counts():
    image = [np.array([levels]) for levels in ([60.0, 240, 200], [60.0, 240, 90], [60.0, 240, 90])]

    def matte(specular):
        return matte_mask(image, True, LdrParams(specular=specular), NATIVE).tolist()

    assert matte("saturation") == [[False, False, True]]
    assert matte("bright") == [[True, False, True]]
    assert matte("off") == [[True, True, True]]


@pytest.mark.parametrize("axes", [2, 3])
def test_a_grey_scene_is_not_taken_for_one_large_highlight(axes):
    image = np.full((4, 4), 90, np.uint8)
    image[0, 0] = 250
    scene = scene_of(image if axes == 2 else np.repeat(image[..., None], 3, axis=2), (4, 4))
    assert not scene.coloured
    assert scene.matte.sum() == 15
    assert not scene.matte[0, 0]


@pytest.mark.parametrize("width", [217, 200])
def test_glints_are_small_bright_and_colourless(width):
    """A white organ is large, a pale spot on a white one does not stand out, and a red lamp has a colour."""
    image = np.full((100, width, 3), (130, 60, 50), np.uint8)
    image[10:15, 20:25] = (250, 245, 248)
    image[10:15, 60:65] = (250, 90, 80)
    image[50:90, 20:80] = (225, 222, 220)
    image[60:64, 40:44] = 250
    image[20:23, 120:123] = 120
    expected = np.ones((100, width), bool)
    expected[10:15, 20:25] = False
    assert (scene_of(image, (100, width), LdrParams(specular="glint")).matte == expected).all()


@pytest.mark.parametrize("size", [(1, 1), (1, 33), (33, 1)])
def test_pictures_of_one_row_or_column_have_glints_too(size):
    image = np.full((*size, 3), 40, np.uint8)
    image[size[0] // 2, size[1] // 2] = 250
    matte = scene_of(image, size, LdrParams(specular="glint")).matte
    assert matte.shape == size
    assert matte.sum() == matte.size - (matte.size > 1)


@pytest.mark.parametrize("seed", range(8))
def test_glints_are_what_rises_over_an_opening(seed):
    """Blobs of all sizes and levels, against the opening of the whole picture."""
    rng = np.random.default_rng(seed)
    size = (int(rng.integers(1, 90)), int(rng.integers(1, 200)))
    image = np.full((*size, 3), 90, np.uint8)
    for _ in range(rng.integers(0, 12)):
        top, left, height, width = rng.integers(0, (*size, 40, 40))
        image[top : top + height + 1, left : left + width + 1] = rng.integers(150, 256) - rng.integers(
            0, 9, 3
        )
    value, lowest = image.max(axis=2).astype(np.float32), image.min(axis=2).astype(np.float32)
    side = max(3, round(0.06 * size[1])) | 1
    opened = opening(value, side)
    expected = (value > 215) & (value - lowest < 60 / 255 * value) & (value - opened > 40)
    assert (scene_of(image, size, LdrParams(specular="glint")).matte == ~expected).all()


def opening(value, side):
    """The least of each window, then the most of these, as far as windows are inside."""
    for reduced, beyond in ((np.min, np.inf), (np.max, -np.inf)):
        padded = np.pad(value, side // 2, constant_values=beyond)
        value = reduced(np.lib.stride_tricks.sliding_window_view(padded, (side, side)), axis=(2, 3))
    return value


@pytest.mark.parametrize("backend", [NATIVE, REFERENCE], ids=lambda backend: backend.name)
@pytest.mark.parametrize("planes", [1, 2, 3])
def test_what_is_bright_and_colourless_is_told_pixel_by_pixel(planes, backend):
    levels = np.random.default_rng(1).integers(170, 256, (planes, 9, 37))
    channels = [np.array(plane, np.float32) for plane in levels]
    found, nearly = backend.glints(channels, GlintRule(saturation=0.2, bright=210, rise=20))
    for place in np.ndindex(9, 37):
        levels = [float(plane[place]) for plane in channels]
        colourless = max(levels) - min(levels) < 0.2 * max(levels)
        assert found[place] == (colourless and max(levels) > 210)
        assert nearly[place] == (max(levels) > 189)
