"""Masks: 0 is not part of the scene."""

from __future__ import annotations

import numpy as np
import pytest

from stereomend.codec import decode_disparity, decode_mask
from stereomend.errors import DamagedFile, TooManyPixels, UnknownFormat

SAMPLES = np.array([[0, 1, 7], [255, 0, 2]], np.uint8)
SHOWN = [[False, True, True], [True, False, True]]


def test_anything_but_0_is_scene_in_every_format(png, npy, tiff):
    deep = SAMPLES.astype(np.uint16) << 8
    with_alpha = np.stack([SAMPLES, SAMPLES[::-1]], axis=2)
    files = [
        *(png(SAMPLES), png(deep, 16), png(SAMPLES > 0, 1), png(with_alpha, 8, 4)),
        *(npy(SAMPLES), npy(deep), npy(SAMPLES > 0), npy(np.asfortranarray(SAMPLES))),
        *(tiff(SAMPLES), tiff(deep), b"P5 3 2 255\n" + SAMPLES.tobytes()),
    ]
    for data in files:
        mask = decode_mask(data, "mask", 100)
        assert mask.dtype == bool
        assert mask.tolist() == SHOWN


def test_bools_of_any_other_byte_than_0_and_1_are_true(npy):
    data = bytearray(npy(np.array([[False, True, True]])))
    data[-2:] = b"\x02\xff"
    assert decode_mask(bytes(data), "mask", 100).view(np.uint8).tolist() == [[0, 1, 1]]


@pytest.mark.parametrize(
    "array", [np.zeros((2, 3, 3), np.uint8), np.zeros((2, 3)), np.zeros((2, 3), np.int32)]
)
def test_colours_and_other_numbers_are_no_mask(npy, array):
    with pytest.raises(UnknownFormat, match=r"^mask: NPY.*expected .*one channel"):
        decode_mask(npy(array), "mask", 100)


def test_broken_and_huge_files_are_refused_as_images_are(png):
    with pytest.raises(DamagedFile, match=r"^mask: "):
        decode_mask(b"", "mask", 100)
    with pytest.raises(DamagedFile, match=r"^mask: "):
        decode_mask(png(SAMPLES)[:-30], "mask", 100)
    with pytest.raises(TooManyPixels, match=r"^mask: 3 x 2"):
        decode_mask(png(SAMPLES), "mask", 5)


def test_an_array_of_bools_is_no_disparity(npy):
    with pytest.raises(UnknownFormat, match="bool"):
        decode_disparity(npy(SAMPLES > 0), "disparity", 100, 1.0)
