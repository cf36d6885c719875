"""PNG: its container is checked and inflated here, within bounds; OpenCV does palettes and interlacing."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from stereomend import _native
from stereomend.codec.deflate import ERRORS, Buffer, crc32, deflated, inflater
from stereomend.codec.headers import Header, Pixels
from stereomend.disparity import FloatMap
from stereomend.errors import DamagedFile, UnknownFormat
from stereomend.opencv import cv2

SIGNATURE = b"\x89PNG\r\n\x1a\n"

_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
_DEPTHS = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}
_PALETTE = 3
_HEADER_END = 33  # signature, then IHDR: length, name, 13 bytes, checksum
_MOST_CHUNKS = 100_000  # real writers need a few hundred per megapixel
_CUT_OFF, _WRONG_CHECKSUM = 1, 2  # of `find_chunks`
_ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
_ONE_PASS = ((0, 0, 1, 1),)


class _Ihdr(NamedTuple):
    width: int
    height: int
    depth: int
    colour: int
    compression: int
    filtering: int
    interlace: int

    @property
    def bits_per_pixel(self) -> int:
        return self.depth * (1 if self.colour == _PALETTE else _CHANNELS[self.colour])


def read_header(data: bytes) -> Header:
    """Read IHDR.

    Raises:
        DamagedFile: it is cut off, has a wrong checksum or values that PNG does not define.
    """
    if len(data) < _HEADER_END or data[8:16] != b"\0\0\0\rIHDR":
        raise DamagedFile("the PNG ends in its header, or has none")
    if crc32(data[12:29]) != int.from_bytes(data[29:33], "big"):
        raise DamagedFile("the header of the PNG has a wrong checksum")
    ihdr = _Ihdr._make(struct.unpack_from(">IIBBBBB", data, 16))
    if ihdr.depth not in _DEPTHS.get(ihdr.colour, ()) or (ihdr.compression, ihdr.filtering) != (0, 0):
        raise DamagedFile(
            f"the PNG has colour type {ihdr.colour} with {ihdr.depth} bits, which PNG does not define"
        )
    if ihdr.interlace > 1:
        raise DamagedFile(f"the PNG has interlace method {ihdr.interlace}, which PNG does not define")
    return Header(
        "PNG",
        ihdr.width,
        ihdr.height,
        _CHANNELS[ihdr.colour],
        np.dtype(np.uint16 if ihdr.depth == 16 else np.uint8),
        lambda: _decode(data, ihdr),
        bits=ihdr.depth,
    )


def write_png16(plane: FloatMap, scale: float) -> bytes:
    """Write a grey PNG of 16 bits, fast rather than small.

    Args:
        plane: (H, W), values from 0 to 65535 / `scale`.
        scale: what they are multiplied by; the products are rounded, halves to even, and at least 1.
    """
    height, width = plane.shape
    rows = _native.filter_levels(np.ascontiguousarray(plane, np.float32), scale)
    ihdr = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    chunks = (_chunk(b"IHDR", ihdr), _chunk(b"IDAT", deflated(rows.data)), _chunk(b"IEND", b""))
    return b"".join((SIGNATURE, *(part for chunk in chunks for part in chunk)))


def _decode(data: bytes, ihdr: _Ihdr) -> Pixels:
    chunks = list(_critical_chunks(data))
    filtered = _inflate((body for kind, body in chunks if kind == b"IDAT"), _filtered_size(ihdr))
    if ihdr.interlace or ihdr.colour == _PALETTE or ihdr.depth < 8:
        palette = [part for kind, body in chunks if kind == b"PLTE" for part in _chunk(kind, body)]
        return _by_opencv(b"".join((data[:_HEADER_END], *palette)), filtered, ihdr)
    return _unfiltered(filtered, ihdr)


def _unfiltered(filtered: bytes, ihdr: _Ihdr) -> Pixels:
    """Undo the filters of samples of 8 or 16 bits: (H, W), or (H, W, channels)."""
    pixel, channels = ihdr.bits_per_pixel // 8, _CHANNELS[ihdr.colour]
    try:
        rows = _native.unfilter(np.frombuffer(filtered, np.uint8), ihdr.height, pixel * ihdr.width, pixel)
    except ValueError as error:
        raise DamagedFile("the PNG holds rows that cannot be decoded") from error
    samples = rows.view(">u2").astype(np.uint16) if ihdr.depth == 16 else rows
    return samples if channels == 1 else samples.reshape(ihdr.height, ihdr.width, channels)


def _by_opencv(head: bytes, filtered: bytes, ihdr: _Ihdr) -> Pixels:
    """Decode a PNG that has nothing but its header and palette, `head`, and pixels, stored uncompressed.

    So transparency, colour profiles, EXIF and animation never reach the decoder, and a bomb neither.
    """
    stored = (*_chunk(b"IDAT", zlib.compress(filtered, 0)), *_chunk(b"IEND", b""))
    plain = np.frombuffer(b"".join((head, *stored)), np.uint8)
    image = cv2.imdecode(plain, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    if image is None or image.shape[:2] != (ihdr.height, ihdr.width):
        raise DamagedFile("the PNG holds rows that cannot be decoded")
    if _CHANNELS[ihdr.colour] <= 2:
        # Grey with alpha comes back as three equal channels.
        return image if image.ndim == 2 else np.ascontiguousarray(image[:, :, 0])
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))


def _critical_chunks(data: bytes) -> Iterator[tuple[bytes, memoryview]]:
    for kind, body in _chunks(data):
        if kind in (b"PLTE", b"IDAT"):
            yield kind, body
        elif kind[0] & 0x20 == 0 and kind != b"IEND":
            raise UnknownFormat(
                "the PNG has a critical chunk that is not in the standard; expected a plain PNG"
            )


def _chunks(data: bytes) -> list[tuple[bytes, memoryview]]:
    """Names and bodies up to IEND (raises DamagedFile)."""
    # Natively, for hundreds of small steps would have all threads that decode wait for one lock.
    found, fault = _native.find_chunks(np.frombuffer(data, np.uint8), _HEADER_END, _MOST_CHUNKS)
    if fault == _CUT_OFF:
        raise DamagedFile(f"the PNG is cut off after {len(data)} bytes, before its end")
    if fault == _WRONG_CHECKSUM:
        raise DamagedFile(f"the PNG has a wrong checksum before byte {sum(found[-1][1:]) + 4}")
    if fault:
        raise DamagedFile(f"the PNG has more than {_MOST_CHUNKS} chunks")
    view = memoryview(data)
    return [(name.to_bytes(4, "big"), view[begin : begin + size]) for name, begin, size in found]


def _inflate(parts: Iterable[memoryview], expected: int) -> bytes:
    stream = inflater()
    try:
        # At once, which takes few calls: one byte too many is all that a bomb can unfold.
        pixels = stream.decompress(b"".join(parts), expected + 1)
    except ERRORS as error:
        raise DamagedFile("the compressed pixels of the PNG are damaged") from error
    if len(pixels) > expected:
        raise DamagedFile(f"the PNG holds more than the {expected} bytes of pixels its header promises")
    if len(pixels) < expected or not stream.eof:
        raise DamagedFile(f"the PNG holds {len(pixels)} bytes of pixels; its header promises {expected}")
    return pixels


def _chunk(kind: bytes, body: Buffer) -> tuple[bytes, Buffer, bytes]:
    return struct.pack(">I4s", len(body), kind), body, struct.pack(">I", crc32(body, crc32(kind)))


def _filtered_size(ihdr: _Ihdr) -> int:
    """Return the bytes of all rows of all passes, each row with its filter byte in front."""
    size = 0
    for x, y, step_x, step_y in _ADAM7 if ihdr.interlace else _ONE_PASS:
        columns, rows = -((x - ihdr.width) // step_x), -((y - ihdr.height) // step_y)
        if columns > 0 and rows > 0:
            size += rows * (1 + (columns * ihdr.bits_per_pixel + 7) // 8)
    return size
