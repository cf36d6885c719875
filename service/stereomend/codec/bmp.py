"""BMP: uncompressed bitmaps with 8 (palette), 24 or 32 bits per pixel."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from stereomend.codec.headers import Header, Pixels, check_length
from stereomend.errors import DamagedFile, UnknownFormat

SIGNATURE = b"BM"

_FILE_HEADER = 14


@dataclass(frozen=True)
class _Layout:
    width: int
    height: int
    bits: int
    palette: np.ndarray[tuple[int, int], np.dtype[np.uint8]]
    start: int
    bottom_up: bool


def read_header(data: bytes) -> Header:
    """Read the file and bitmap headers.

    Raises:
        DamagedFile: they are cut off or contradict each other.
        UnknownFormat: the bitmap is compressed or has another depth.
    """
    if len(data) < _FILE_HEADER + 40:
        raise DamagedFile(f"the BMP is cut off in its header, after {len(data)} bytes")
    start, size, width, height, planes, bits, compression = struct.unpack_from("<IIiiHHI", data, 10)
    if size < 40 or planes != 1 or compression != 0 or bits not in (8, 24, 32):
        raise UnknownFormat(
            f"BMP with {bits} bits and compression {compression}; expected 8, 24 or 32 bits and none"
        )
    if width < 0 or start < _FILE_HEADER + size:
        raise DamagedFile("the BMP header has a negative width, or pixels that start inside it")
    palette = _palette(data, _FILE_HEADER + size, start) if bits == 8 else np.empty((0, 3), np.uint8)
    layout = _Layout(width, abs(height), bits, palette, start, bottom_up=height > 0)
    channels = 1 if bits == 8 and _is_grey(palette) else 3
    return Header("BMP", width, abs(height), channels, np.dtype(np.uint8), lambda: _decode(data, layout))


def _palette(data: bytes, at: int, start: int) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    (used,) = struct.unpack_from("<I", data, 46)
    entries = used or 256
    if entries > 256 or at + 4 * entries > min(start, len(data)):
        raise DamagedFile("the palette of the BMP is cut off")
    palette = np.zeros((256, 3), np.uint8)
    palette[:entries] = np.frombuffer(data, np.uint8, 4 * entries, at).reshape(-1, 4)[:, 2::-1]
    return palette


def _is_grey(palette: Pixels) -> bool:
    return bool((palette == palette[:, :1]).all())


def _decode(data: bytes, layout: _Layout) -> Pixels:
    stride = (layout.width * layout.bits + 31) // 32 * 4
    check_length("BMP", len(data), layout.start + stride * layout.height)
    rows = np.frombuffer(data, np.uint8, stride * layout.height, layout.start).reshape(layout.height, stride)
    rows = rows[:: -1 if layout.bottom_up else 1, : layout.width * layout.bits // 8]
    if layout.bits == 8:
        palette = layout.palette[:, 0] if _is_grey(layout.palette) else layout.palette
        return np.asarray(palette[rows])
    # Stored as blue, green, red and, with 32 bits, a byte that is padding or alpha.
    return rows.reshape(layout.height, layout.width, layout.bits // 8)[:, :, 2::-1].copy()
