"""PFM, binary PGM and PPM: a line of text, then plain samples."""

from __future__ import annotations

import math
import re

import numpy as np

from stereomend.codec.headers import Header, Pixels, check_length
from stereomend.errors import DamagedFile, UnknownFormat

PFM_SIGNATURES = (b"Pf", b"PF")
PNM_SIGNATURES = (b"P5", b"P6")

_LONGEST_HEADER = 4096
_GAP = rb"(?:\s|#[^\r\n]*[\r\n])+"  # PNM allows comments
_PNM = re.compile(rb"P[56]%b(\d{1,10})%b(\d{1,10})%b(\d{1,10})(?:\r\n|\s)" % (_GAP, _GAP, _GAP))
_PFM = re.compile(rb"P[fF]\s+(\d{1,10})\s+(\d{1,10})\s+([-+.\deE]{1,40})(?:\r\n|\s)")


def read_pfm(data: bytes) -> Header:
    """Read the header of a PFM: bottom row first, little-endian if the scale is negative.

    Raises:
        DamagedFile: the header is cut off or damaged, or the scale is 0 or no number.
    """
    found = _PFM.match(data, 0, _LONGEST_HEADER)
    if found is None:
        raise DamagedFile("the PFM header is cut off or damaged; expected Pf, width, height and scale")
    scale = _number(found[3])
    if scale == 0 or not math.isfinite(scale):
        raise DamagedFile("the scale of the PFM is 0 or no number; its sign must tell the byte order")
    width, height, channels = int(found[1]), int(found[2]), 1 if data[:2] == b"Pf" else 3

    def decode() -> Pixels:
        stored = np.dtype("<f4" if scale < 0 else ">f4")
        return _samples(data, "PFM", found.end(), (height, width, channels), stored)[::-1].copy()

    return Header("PFM", width, height, channels, np.dtype(np.float32), decode)


def read_pnm(data: bytes) -> Header:
    """Read the header of a binary PGM or PPM.

    Raises:
        DamagedFile: the header is cut off or damaged.
        UnknownFormat: the largest value is not 255 or 65535.
    """
    found = _PNM.match(data, 0, _LONGEST_HEADER)
    if found is None:
        raise DamagedFile(
            "the PNM header is cut off or damaged; expected P5 or P6, width, height and largest value"
        )
    width, height, largest = map(int, found.groups())
    if largest not in (255, 65535):
        raise UnknownFormat(f"PNM with the largest value {largest}; expected 255 or 65535")
    channels, stored = 1 if data[:2] == b"P5" else 3, np.dtype(np.uint8 if largest == 255 else ">u2")

    def decode() -> Pixels:
        return _samples(data, "PNM", found.end(), (height, width, channels), stored)

    return Header("PNM", width, height, channels, stored.newbyteorder("="), decode)


def _samples(
    data: bytes, kind: str, start: int, shape: tuple[int, int, int], stored: np.dtype[np.generic]
) -> Pixels:
    """Copy the samples in native byte order; shape (H, W) for one channel."""
    check_length(kind, len(data), start + math.prod(shape) * stored.itemsize)
    samples = np.frombuffer(data, stored, math.prod(shape), start).astype(stored.newbyteorder("="))
    return samples.reshape(shape[:2] if shape[2] == 1 else shape)


def _number(text: bytes) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
