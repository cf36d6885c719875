"""From the bytes of an upload to a disparity map."""

from __future__ import annotations

import math

import numpy as np

from stereomend.codec.formats import read_header
from stereomend.codec.headers import Header, Pixels, check_size, named
from stereomend.disparity import DisparityMap
from stereomend.errors import InvalidParameter, UnknownFormat

EXPECTED = "16-bit PNG, NPY, PFM (Pf) or TIFF with one channel"
PNG16_SCALE = 256.0
"""Divisor of 16-bit PNG unless another is given [1/px]."""

_FORMATS = ("PNG", "NPY", "PFM", "TIFF")


def decode_disparity(data: bytes, name: str, max_pixels: int, scale: float | None = None) -> DisparityMap:
    """Decode a disparity map.

    Floats are pixels as they stand. Integers are divided by `scale`; only 16-bit PNG has a default, 256.
    Bytes after the end of the map are ignored, and so is the size of the scale of a PFM.

    Args:
        data: the file.
        name: what messages call it, `disparity` for example.
        max_pixels: width times height above which nothing is decoded.
        scale: divisor of integer maps [1/px].

    Returns:
        The map, shape (H, W), in pixels; unknown (not finite, or not above 0) pixels hold 0.

    Raises:
        UnknownFormat: the file is in no format read here, or has several channels.
        DamagedFile: the file is empty, cut off or corrupt, or a map without pixels.
        TooManyPixels: the header promises more than `max_pixels`.
        InvalidParameter: `scale` is missing for integers, given for floats (dividing those would be a guess),
            or not a finite number above 0.
        WorkLimitExceeded: the memory does not suffice.
    """
    with named(name):
        header = read_header(data, EXPECTED)
        check_size(header, max_pixels)
        _check_type(header)
        divisor = _divisor(header, scale)
        pixels = header.decode()
        return DisparityMap.from_array(pixels if divisor is None else _divided(pixels, divisor))


def _check_type(header: Header) -> None:
    # A PNG of 1, 2 or 4 bits is spread to 8, which keeps pictures but not numbers.
    no_numbers = header.bits in (1, 2, 4) or header.dtype.kind == "b"
    if header.format not in _FORMATS or header.channels != 1 or no_numbers:
        raise UnknownFormat(f"{header}; expected {EXPECTED}")


def _divisor(header: Header, scale: float | None) -> float | None:
    if scale is not None and not (math.isfinite(scale) and scale > 0):
        raise InvalidParameter(f"disparity_scale is {scale}; expected a finite number above 0")
    if header.dtype.kind == "f":
        if scale is not None:
            raise InvalidParameter(
                f"disparity_scale is {scale:g}, but a {header.format} of {header.dtype} holds pixels "
                "already; leave disparity_scale out"
            )
        return None
    if scale is None and header.bits != 16:
        raise InvalidParameter(
            f"disparity_scale is missing: a {header.format} of {header.dtype} needs the number to divide by "
            "(only 16-bit PNG has a default, 256)"
        )
    return PNG16_SCALE if scale is None else scale


def _divided(pixels: Pixels, divisor: float) -> Pixels:
    """The quotient rounded to float32 once; what overflows is infinite, hence unknown."""
    # In float32 where it holds both numbers, which is three times as fast.
    exact = pixels.dtype.itemsize <= 2 and float(np.float32(divisor)) == divisor
    kind = np.float32 if exact else np.float64
    quotient = np.empty(pixels.shape, np.float32)
    with np.errstate(over="ignore"):
        np.divide(pixels, kind(divisor), out=quotient, dtype=kind, casting="same_kind")
    return quotient
