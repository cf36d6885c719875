"""From the bytes of an upload to a left or right image."""

from __future__ import annotations

import numpy as np

from stereomend.codec.formats import read_header
from stereomend.codec.headers import check_size, named
from stereomend.disparity import Image, Mask, as_mask
from stereomend.errors import UnknownFormat

EXPECTED = "PNG, JPEG, TIFF, BMP, binary PNM or NPY with uint8 or uint16, grey or RGB"
MASK_EXPECTED = "PNG, TIFF, BMP, binary PNM or NPY with one channel of uint8, uint16 or, in NPY, bool"


def decode_image(data: bytes, name: str, max_pixels: int) -> Image:
    """Decode a left or right image.

    Alpha is dropped, palettes are expanded, fewer than 8 bits spread to 8. Orientation tags, colour profiles
    and bytes after the end of the image are ignored.

    Args:
        data: the file.
        name: what messages call it, `left` for example.
        max_pixels: width times height above which nothing is decoded.

    Returns:
        uint8 or uint16, shape (H, W) for grey or (H, W, 3) for RGB, in memory of its own, row by row.

    Raises:
        UnknownFormat: the file is in no format read here, or holds other samples.
        DamagedFile: the file is empty, cut off or corrupt, or an image without pixels.
        TooManyPixels: the header promises more than `max_pixels`.
        WorkLimitExceeded: the memory does not suffice.
    """
    with named(name):
        header = read_header(data, EXPECTED)
        check_size(header, max_pixels)
        if header.dtype not in (np.uint8, np.uint16):
            raise UnknownFormat(f"{header}; expected {EXPECTED}")
        pixels = header.decode()
        if pixels.ndim == 3:
            pixels = pixels[:, :, 0] if pixels.shape[2] <= 2 else pixels[:, :, :3]
        return np.ascontiguousarray(pixels)


def image_size(data: bytes, name: str, max_pixels: int) -> tuple[int, int]:
    """Width and height [px] that the header of an image promises; arguments and errors as `decode_image`."""
    with named(name):
        header = read_header(data, EXPECTED)
        check_size(header, max_pixels)
        return header.width, header.height


def decode_mask(data: bytes, name: str, max_pixels: int) -> Mask:
    """Decode a mask: 0 is not part of the scene, anything else is. Alpha is dropped.

    Args:
        data: an image file with one channel, or an NPY of bool; lossless, since 0 must stay 0.
        name: what messages call it, `mask` for example.
        max_pixels: width times height above which nothing is decoded.

    Returns:
        bool, shape (H, W), true where the scene is.

    Raises:
        UnknownFormat: the file is in no format read here, has several channels, or holds other samples.
        DamagedFile: the file is empty, cut off or corrupt, or an image without pixels.
        TooManyPixels: the header promises more than `max_pixels`.
        WorkLimitExceeded: the memory does not suffice.
    """
    with named(name):
        header = read_header(data, MASK_EXPECTED)
        check_size(header, max_pixels)
        if header.channels > 2 or header.dtype not in (np.bool_, np.uint8, np.uint16):
            raise UnknownFormat(f"{header}; expected {MASK_EXPECTED}")
        pixels = header.decode()
        return as_mask(pixels if pixels.ndim == 2 else pixels[:, :, 0])
