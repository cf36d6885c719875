"""What a file promises before a pixel of it is decoded, and the checks on that promise."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from stereomend.errors import DamagedFile, InputError, TooManyPixels, WorkLimitExceeded

Pixels = npt.NDArray[Any]

LONGEST_SIDE = 1 << 20
"""OpenCV decodes no image with a longer side [px]."""


@dataclass(frozen=True)
class Header:
    """Format, size and type of an image file, and the way to its pixels."""

    format: str
    """`PNG`, `JPEG`, `TIFF`, `NPY`, `PFM`, `PNM` or `BMP`."""
    width: int
    """Pixels."""
    height: int
    """Pixels."""
    channels: int
    """As stored: 1 grey, 2 grey and alpha, 3 RGB or palette, 4 RGB and alpha."""
    dtype: np.dtype[Any]
    """Of the decoded samples."""
    decode: Callable[[], Pixels]
    """Decodes shape (H, W) or (H, W, channels), RGB; allocates, so call it after `check_size` only."""
    bits: int = 0
    """Per stored sample; 0: as many as `dtype` has."""

    def __str__(self) -> str:
        samples = f"{self.bits}-bit" if self.bits else str(self.dtype)
        return f"{self.format} of {samples}, {self.channels} channel{'s'[: self.channels != 1]}"


def check_size(header: Header, max_pixels: int) -> None:
    """Refuse an image without pixels or with too many.

    Raises:
        DamagedFile: a side is 0.
        TooManyPixels: more than `max_pixels`, or a side longer than `LONGEST_SIDE`.
    """
    size = f"{header.width} x {header.height} (width x height)"
    if header.width < 1 or header.height < 1:
        raise DamagedFile(f"the {header.format} promises {size} pixels; expected at least 1 x 1")
    if header.width * header.height > max_pixels:
        raise TooManyPixels(f"{size} pixels; this server takes {max_pixels}")
    if max(header.width, header.height) > LONGEST_SIDE:
        raise TooManyPixels(f"{size} pixels; no side may be longer than {LONGEST_SIDE}")


def check_length(kind: str, came: int, expected: int) -> None:
    """Refuse a file that ends before the pixels its header promises (raises DamagedFile)."""
    if came < expected:
        raise DamagedFile(f"the {kind} is cut off: {came} bytes came, its header promises {expected}")


@contextmanager
def named(name: str) -> Iterator[None]:
    """Put the name of the request's part in front of every error, and let nothing but our errors out.

    Raises:
        InputError: what was raised inside, with the name in front; DamagedFile for anything unforeseen.
        WorkLimitExceeded: the memory does not suffice.
    """
    try:
        yield
    except InputError as error:
        raise type(error)(f"{name}: {error}") from error
    except MemoryError as error:
        raise WorkLimitExceeded(f"{name}: decoding needs more memory than there is") from error
    # Decoders that others wrote raise what they like on a broken file.
    except Exception as error:
        raise DamagedFile(f"{name}: cannot be decoded ({type(error).__name__})") from error
