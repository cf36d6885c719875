"""The pixels of a TIFF: each strip or tile is unpacked to exactly the size it must have."""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from stereomend.codec.headers import Pixels, check_length
from stereomend.errors import DamagedFile
from stereomend.opencv import cv2

_NONE, _LZW, _DEFLATE, _PACKBITS, _OLD_DEFLATE = 1, 5, 8, 32773, 32946
COMPRESSIONS = {
    _NONE: "none",
    _LZW: "LZW",
    _DEFLATE: "deflate",
    _OLD_DEFLATE: "old deflate",
    _PACKBITS: "PackBits",
}
"""What is read, by the value of the tag Compression."""
PREDICTABLE = (_LZW, _DEFLATE, _OLD_DEFLATE)
"""The compressions that a predictor may precede."""


_STRIP_AT = 8 + 2 + 9 * 12 + 4  # after file header and a directory of nine tags

Buffer = bytes | memoryview


@dataclass(frozen=True)
class Layout:
    """Where the samples of a TIFF lie and how they are packed; a strip is a tile as wide as the image."""

    width: int
    height: int
    channels: int
    stored: np.dtype[Any]
    """Type with the byte order of the file."""
    compression: int
    predictor: int
    """1 none, 2 horizontal differences, 3 the same on the bytes of floats."""
    planar: bool
    """Whether each channel has its own strips or tiles, all of the first channel first."""
    segment_width: int
    segment_height: int
    tiled: bool
    """Tiles are always stored whole; the last strip may be shorter."""
    offsets: tuple[int, ...]
    counts: tuple[int, ...]

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of strips or tiles of one plane."""
        return math.ceil(self.height / self.segment_height), math.ceil(self.width / self.segment_width)

    @property
    def segments(self) -> int:
        """The number of strips or tiles of all planes."""
        return math.prod(self.grid) * (self.channels if self.planar else 1)


def decode(data: bytes, layout: Layout) -> Pixels:
    """Decode to shape (H, W), or (H, W, channels), in native byte order.

    Raises:
        DamagedFile: a strip or tile lies outside the file, is damaged or holds too little.
    """
    image = np.empty((layout.height, layout.width, layout.channels), layout.stored.newbyteorder("="))
    rows, columns = layout.grid
    for index in range(layout.segments):
        plane, place = divmod(index, rows * columns)
        top, left = place // columns * layout.segment_height, place % columns * layout.segment_width
        target = image[top : top + layout.segment_height, left : left + layout.segment_width]
        target = target[:, :, plane : plane + 1] if layout.planar else target
        height = layout.segment_height if layout.tiled else target.shape[0]
        segment = _segment(data, layout, index, (height, layout.segment_width, target.shape[2]))
        target[:] = segment[: target.shape[0], : target.shape[1]]
    return image[:, :, 0] if layout.channels == 1 else image


def _segment(data: bytes, layout: Layout, index: int, shape: tuple[int, int, int]) -> Pixels:
    start, size = layout.offsets[index], layout.counts[index]
    check_length("TIFF", len(data), start + size)
    row = shape[1] * shape[2] * layout.stored.itemsize
    unpacked = _unpacked(memoryview(data)[start : start + size], layout.compression, shape[0], row)
    if len(unpacked) < shape[0] * row:
        raise DamagedFile(
            f"strip or tile {index} of the TIFF holds {len(unpacked)} bytes; expected {shape[0] * row}"
        )
    if layout.predictor == 3:
        return _undo_float_predictor(np.frombuffer(unpacked, np.uint8), shape, layout.stored.itemsize)
    samples = np.frombuffer(unpacked, layout.stored, math.prod(shape)).astype(layout.stored.newbyteorder("="))
    samples = samples.reshape(shape)
    if layout.predictor == 2:
        bits = samples.view(f"u{samples.itemsize}")  # floats too are differences of their bits
        np.cumsum(bits, axis=1, dtype=bits.dtype, out=bits)
    return samples


def _unpacked(packed: memoryview, compression: int, rows: int, row: int) -> Buffer:
    """Return at most `rows * row` bytes; fewer if the segment holds fewer."""
    if compression == _NONE:
        return packed[: rows * row]
    if compression in (_DEFLATE, _OLD_DEFLATE):
        return _inflated(packed, rows * row)
    return _unpacked_by_libtiff(packed, compression, rows, row)


def _inflated(packed: memoryview, most: int) -> bytes:
    try:
        return zlib.decompressobj().decompress(packed, most)
    except zlib.error as error:
        raise DamagedFile("a strip or tile of the TIFF is damaged") from error


def _unpacked_by_libtiff(packed: memoryview, compression: int, rows: int, row: int) -> bytes:
    """Unpack LZW or PackBits: libtiff sees one strip behind a directory written here, whatever the file said.

    16-bit samples, because OpenCV reports damage in these but not in 8-bit ones. Where the number of bytes is
    odd, the last row is taken from an 8-bit strip.
    """
    if row % 2 == 0:
        return _grey_strip(packed, compression, (rows, row // 2), np.dtype("<u2"))
    if rows % 2 == 0:
        return _grey_strip(packed, compression, (rows // 2, row), np.dtype("<u2"))
    checked = _grey_strip(packed, compression, (rows // 2, row), np.dtype("<u2")) if rows > 1 else b""
    return checked + _grey_strip(packed, compression, (rows, row), np.dtype(np.uint8))[-row:]


def _grey_strip(packed: memoryview, compression: int, shape: tuple[int, int], dtype: np.dtype[Any]) -> bytes:
    height, width = shape
    entries = (
        *((256, width), (257, height), (258, 8 * dtype.itemsize), (259, compression), (262, 1)),
        *((273, _STRIP_AT), (277, 1), (278, height), (279, len(packed))),
    )
    directory = b"".join(struct.pack("<HHII", code, 4, 1, value) for code, value in entries)
    file = b"".join((struct.pack("<4sIH", b"II*\0", 8, len(entries)), directory, bytes(4), packed))
    strip = cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_UNCHANGED)
    if strip is None or strip.shape != shape:
        raise DamagedFile("a strip or tile of the TIFF is damaged")
    return strip.astype(dtype).tobytes()


def _undo_float_predictor(stored: Pixels, shape: tuple[int, int, int], size: int) -> Pixels:
    """Sum up the bytes of each row, then gather them: all most significant ones are stored first."""
    height, width, channels = shape
    summed = np.cumsum(stored.reshape(height, -1, channels), axis=1, dtype=np.uint8)
    planes = summed.reshape(height, size, width * channels)
    samples = np.ascontiguousarray(planes.transpose(0, 2, 1)).view(f">f{size}")
    return samples.reshape(shape)
