"""JPEG: the markers are walked here; OpenCV (libjpeg-turbo) decodes what passed."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from stereomend.codec.headers import Header, Pixels
from stereomend.errors import DamagedFile, UnknownFormat
from stereomend.opencv import cv2

SIGNATURE = b"\xff\xd8\xff"

_EOI, _SOS, _DHT, _JPG, _DAC = 0xD9, 0xDA, 0xC4, 0xC8, 0xCC
_FRAMES = set(range(0xC0, 0xD0)) - {_DHT, _JPG, _DAC}
_DECODABLE = {0xC0: "baseline", 0xC1: "extended", 0xC2: "progressive"}
_MOST_SEGMENTS = 10_000
_MOST_SCANS = 32  # each may cost a pass over all pixels; real progressive files have about 10
_MARKER = re.compile(rb"\xff+[^\xff]")  # with fill bytes in front
# After a scan's header: the next marker that is neither a stuffed 0xFF, a fill byte nor a restart.
_NEXT_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")


class _Segment(NamedTuple):
    marker: int
    body: memoryview


def read_header(data: bytes) -> Header:
    """Read the frame header (SOF).

    Raises:
        DamagedFile: the markers before it are broken, or there is none.
        UnknownFormat: the coding is not baseline, extended or progressive, 8 bits, grey or colour.
    """
    for marker, body in _segments(data):
        if marker in _FRAMES:
            return _frame(data, marker, body)
        if marker == _SOS:
            break
    raise DamagedFile("the JPEG has no frame header")


def _frame(data: bytes, marker: int, body: memoryview) -> Header:
    if len(body) < 6 or len(body) != 6 + 3 * body[5]:
        raise DamagedFile("the frame header of the JPEG is damaged")
    bits, height, width, channels = struct.unpack(">BHHB", body[:6])
    if marker not in _DECODABLE or bits != 8 or channels not in (1, 3):
        raise UnknownFormat(
            f"JPEG with coding {marker - 0xC0}, {bits} bits and {channels} components; "
            "expected baseline or progressive, 8 bits, 1 or 3 components"
        )
    return Header(
        "JPEG", width, height, channels, np.dtype(np.uint8), lambda: _decode(data, (height, width), channels)
    )


def _decode(data: bytes, shape: tuple[int, int], channels: int) -> Pixels:
    _check_markers(data)
    colour = cv2.IMREAD_COLOR if channels == 3 else cv2.IMREAD_GRAYSCALE
    image = cv2.imdecode(np.frombuffer(data, np.uint8), colour | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None or image.shape[:2] != shape:
        raise DamagedFile("the JPEG cannot be decoded")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB)) if channels == 3 else image


def _check_markers(data: bytes) -> None:
    """Refuse a file without an end or with more frames or scans than one image needs.

    libjpeg replaces missing data by grey and only prints a warning, so a cut must be found here.
    """
    markers = [segment.marker for segment in _segments(data)]
    if sum(marker in _FRAMES for marker in markers) != 1:
        raise DamagedFile("the JPEG has several frame headers")
    if not 1 <= markers.count(_SOS) <= _MOST_SCANS:
        raise DamagedFile(f"the JPEG has {markers.count(_SOS)} scans; expected 1 to {_MOST_SCANS}")


def _segments(data: bytes) -> Iterator[_Segment]:
    """Yield every segment up to the end of the image (raises DamagedFile where the chain breaks)."""
    view, at = memoryview(data), 2
    for _ in range(_MOST_SEGMENTS):
        found = _MARKER.match(data, at)
        at = found.end() - 2 if found else at
        marker = data[at + 1] if found else None
        if marker == _EOI:
            return
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        if marker is None or length < 2 or at + 2 + length > len(data):
            raise DamagedFile(
                f"the JPEG is cut off or damaged: no complete segment at byte {at} of {len(data)}"
            )
        yield _Segment(marker, view[at + 4 : at + 2 + length])
        at = _scan_end(data, at + 2 + length) if marker == _SOS else at + 2 + length
    raise DamagedFile(f"the JPEG has more than {_MOST_SEGMENTS} segments")


def _scan_end(data: bytes, start: int) -> int:
    found = _NEXT_MARKER.search(data, start)
    if found is None:
        raise DamagedFile(f"the JPEG is cut off after {len(data)} bytes, before its end")
    return found.start()
