"""The native filters against the specification, byte by byte."""

import numpy as np
import pytest

from stereomend import _native
from stereomend.codec import decode_disparity, decode_image
from stereomend.errors import DamagedFile
from stereomend.opencv import cv2

SIZES = [(1, 1), (1, 13), (13, 1), (3, 5), (7, 9), (37, 53)]
KINDS = {1: (0, 8, 1), 2: (0, 16, 1), 3: (2, 8, 3), 4: (6, 8, 4), 6: (2, 16, 3), 8: (6, 16, 4)}
"""Colour type, bits and channels by bytes per pixel."""


def paeth(left, up, corner):
    """PNG, third edition, section 9.4."""
    estimate = left + up - corner
    return min((left, up, corner), key=lambda value: abs(estimate - value))


PREDICTIONS = (
    lambda left, up, corner: 0,
    lambda left, up, corner: left,
    lambda left, up, corner: up,
    lambda left, up, corner: (left + up) // 2,
    paeth,
)


def unfiltered(rows, pixel):
    """Undo the filters of rows (H, 1 + stride), one byte after the other."""
    rows, (height, stride) = rows.astype(int), (rows.shape[0], rows.shape[1] - 1)
    out = np.zeros((height + 1, pixel + stride), int)  # outside is 0
    for y in range(height):
        for x in range(stride):
            around = out[y + 1, x], out[y, pixel + x], out[y, x]
            out[y + 1, pixel + x] = (rows[y, 1 + x] + PREDICTIONS[rows[y, 0]](*map(int, around))) % 256
    return out[1:, pixel:].astype(np.uint8)


def filtered(random, size, pixel, filters=range(5)):
    height, width = size
    rows = random.integers(0, 256, (height, 1 + pixel * width), dtype=np.uint8)
    rows[:, 0] = random.choice(list(filters), height)
    return rows


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("pixel", KINDS)
def test_mixed_filters_are_undone_as_specified(random, size, pixel):
    rows = filtered(random, size, pixel)
    found = _native.unfilter(rows.ravel(), size[0], pixel * size[1], pixel)
    np.testing.assert_array_equal(found, unfiltered(rows, pixel))


@pytest.mark.parametrize("number", range(5))
@pytest.mark.parametrize("pixel", KINDS)
def test_each_filter_alone_is_undone_as_specified(random, number, pixel):
    rows = filtered(random, (6, 11), pixel, [number])
    found = _native.unfilter(rows.ravel(), 6, 11 * pixel, pixel)
    np.testing.assert_array_equal(found, unfiltered(rows, pixel))


@pytest.mark.parametrize("pixel", KINDS)
def test_filtered_files_decode_as_opencv_decodes_them(png, random, pixel):
    colour, depth, channels = KINDS[pixel]
    rows = filtered(random, (19, 23), pixel)
    data = png.ihdr(23, 19, depth, colour) + png.body(rows.tobytes())
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    expected = image if channels == 1 else cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    np.testing.assert_array_equal(decode_image(data, "left", 1000), expected)


def test_a_filtered_disparity_map_is_divided_by_256(png, random):
    rows = filtered(random, (5, 8), 2)
    data = png.ihdr(8, 5, 16) + png.body(rows.tobytes())
    expected = unfiltered(rows, 2).view(">u2") / 256
    np.testing.assert_array_equal(decode_disparity(data, "disparity", 1000).values, expected)


@pytest.mark.parametrize("number", [5, 6, 255])
def test_an_unknown_filter_in_the_last_row_is_damage(png, random, number):
    rows = filtered(random, (4, 6), 3)
    rows[-1, 0] = number
    with pytest.raises(DamagedFile, match=r"^left: .*cannot be decoded"):
        decode_image(png.ihdr(6, 4, 8, 2) + png.body(rows.tobytes()), "left", 1000)
    with pytest.raises(ValueError, match="filter"):
        _native.unfilter(rows.ravel(), 4, 18, 3)


@pytest.mark.parametrize(
    ("height", "stride", "pixel", "says"),
    [
        (4, 18, 5, "bytes_per_pixel"),
        (4, 18, 0, "bytes_per_pixel"),
        (4, 18, 4, "whole pixels"),
        (3, 18, 3, "height rows"),
        (5, 18, 3, "height rows"),
        (4, 15, 3, "height rows"),
        (0, 18, 3, "no pixel"),
        (4, 0, 3, "no pixel"),
        ((1 << 20) + 1, 18, 3, "a side over"),
        (4, 3 * ((1 << 20) + 1), 3, "a side over"),
    ],
)
def test_rows_of_another_size_are_refused(height, stride, pixel, says):
    with pytest.raises(ValueError, match=says):
        _native.unfilter(np.zeros(4 * 19, np.uint8), height, stride, pixel)


def test_rows_of_another_type_are_refused():
    with pytest.raises(TypeError):
        _native.unfilter(np.zeros(4 * 19, np.int16), 4, 18, 3)
    with pytest.raises(TypeError):
        _native.unfilter(np.zeros((4, 19), np.uint8), 4, 18, 3)


def test_a_png_as_libpng_writes_it_comes_back(random):
    image = cv2.GaussianBlur(random.integers(0, 256, (40, 60, 3), dtype=np.uint8), (9, 9), 3)
    for strategy in (cv2.IMWRITE_PNG_FILTER_PAETH, cv2.IMWRITE_PNG_FILTER_AVG, cv2.IMWRITE_PNG_ALL_FILTERS):
        data = cv2.imencode(".png", image, (cv2.IMWRITE_PNG_FILTER, strategy))[1].tobytes()
        np.testing.assert_array_equal(decode_image(data, "left", 4000), image[..., ::-1])
