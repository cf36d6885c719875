"""TIFF: the directory is read here, tag by tag, because general readers trust what it says.

They follow vendors' tags, chains of pages and any compression; of those, a rectified image or a disparity map
needs nothing. What is read: classic TIFF, one page, strips or tiles, grey or RGB, integers or floats.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from stereomend.codec.headers import Header
from stereomend.codec.tiff_segments import COMPRESSIONS, PREDICTABLE, Layout, decode
from stereomend.errors import DamagedFile, UnknownFormat

SIGNATURES = (b"II*\0", b"MM\0*")
BIG_SIGNATURES = (b"II+\0", b"MM\0+")

_TYPES = {1: "B", 3: "H", 4: "I"}  # BYTE, SHORT, LONG: all that the tags below may have
_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _PHOTOMETRIC, _FILL_ORDER = 256, 257, 258, 259, 262, 266
_STRIP_OFFSETS, _SAMPLES, _ROWS_PER_STRIP, _STRIP_COUNTS, _PLANAR, _PREDICTOR = 273, 277, 278, 279, 284, 317
_TILE_WIDTH, _TILE_HEIGHT, _TILE_OFFSETS, _TILE_COUNTS, _SAMPLE_FORMAT = 322, 323, 324, 325, 339
_SINGLE = {
    _WIDTH: 0,
    _HEIGHT: 0,
    _COMPRESSION: 1,
    _PHOTOMETRIC: 1,
    _FILL_ORDER: 1,
    _SAMPLES: 1,
    _ROWS_PER_STRIP: 2**32 - 1,
    _PLANAR: 1,
    _PREDICTOR: 1,
    _TILE_WIDTH: 0,
    _TILE_HEIGHT: 0,
}
_LISTS: dict[int, tuple[int, ...]] = {
    _BITS: (1,),
    _SAMPLE_FORMAT: (1,),
    _STRIP_OFFSETS: (),
    _STRIP_COUNTS: (),
    _TILE_OFFSETS: (),
    _TILE_COUNTS: (),
}
_MOST_SEGMENTS = 1 << 16
_KINDS = {1: "u", 2: "i", 3: "f"}
_BYTES = {"u": (1, 2, 4, 8), "i": (1, 2, 4, 8), "f": (2, 4, 8)}
_CHANNELS = {1: (1, 2), 2: (3, 4)}  # grey, RGB; each with or without alpha


@dataclass(frozen=True)
class _Tags:
    single: Mapping[int, int]
    lists: Mapping[int, tuple[int, ...]]


def read_header(data: bytes) -> Header:
    """Read the only directory of a TIFF; its orientation is ignored.

    Raises:
        DamagedFile: the directory is cut off or contradicts itself.
        UnknownFormat: BigTIFF, several pages, or a compression, layout or type that is not read here.
    """
    if data[:4] in BIG_SIGNATURES:
        raise UnknownFormat("BigTIFF; expected classic TIFF")
    order = "<" if data[:2] == b"II" else ">"
    tags = _read_tags(data, order)
    layout = _layout(tags, np.dtype(order + _sample_type(tags)))
    if sum(layout.counts) > len(data):
        raise DamagedFile(
            f"the TIFF is cut off: {len(data)} bytes came, its strips or tiles have {sum(layout.counts)}"
        )
    width, height, channels = layout.width, layout.height, layout.channels
    return Header(
        "TIFF", width, height, channels, layout.stored.newbyteorder("="), lambda: decode(data, layout)
    )


def _read_tags(data: bytes, order: str) -> _Tags:
    (start,) = _unpack(data, order + "I", 4)
    (entries,) = _unpack(data, order + "H", start)
    (following,) = _unpack(data, order + "I", start + 2 + 12 * entries)
    if following:
        raise UnknownFormat("TIFF with several pages; expected one")
    places = [
        (int(_unpack(data, order + "H", at)[0]), at) for at in range(start + 2, start + 2 + 12 * entries, 12)
    ]
    if len(dict(places)) < len(places):
        raise DamagedFile("the directory of the TIFF lists a tag twice")
    single = {code: _values(data, order, at, 1)[0] for code, at in places if code in _SINGLE}
    lists = {code: _values(data, order, at, _MOST_SEGMENTS) for code, at in places if code in _LISTS}
    return _Tags(_SINGLE | single, _LISTS | lists)


def _values(data: bytes, order: str, at: int, most: int) -> tuple[int, ...]:
    code, kind, count = _unpack(data, order + "HHI", at)
    if kind not in _TYPES or not 1 <= count <= most:
        raise DamagedFile(f"tag {code} of the TIFF has {count} values of type {kind}")
    form = f"{order}{count}{_TYPES[kind]}"
    if struct.calcsize(form) <= 4:
        return _unpack(data, form, at + 8)
    return _unpack(data, form, _unpack(data, order + "I", at + 8)[0])


def _unpack(data: bytes, form: str, at: int) -> tuple[Any, ...]:
    if at + struct.calcsize(form) > len(data):
        raise DamagedFile(f"the TIFF is cut off: its directory points to byte {at}, {len(data)} came")
    return struct.unpack_from(form, data, at)


def _sample_type(tags: _Tags) -> str:
    bits, formats = set(tags.lists[_BITS]), set(tags.lists[_SAMPLE_FORMAT])
    size, kind = next(iter(bits)) // 8, _KINDS.get(next(iter(formats)), "")
    if len(bits) > 1 or len(formats) > 1 or bits != {8 * size} or size not in _BYTES.get(kind, ()):
        raise UnknownFormat(
            f"TIFF of {sorted(bits)[:4]} bits and sample format {sorted(formats)[:4]}; "
            "expected integers of 8 to 64 or floats of 16 to 64 bits, equal for all samples"
        )
    return f"{kind}{size}"


def _layout(tags: _Tags, stored: np.dtype[Any]) -> Layout:
    _check_offered(tags.single, stored)
    tiled = bool(tags.lists[_TILE_OFFSETS])
    width, height = tags.single[_WIDTH], tags.single[_HEIGHT]
    layout = Layout(
        width=width,
        height=height,
        channels=tags.single[_SAMPLES],
        stored=stored,
        compression=tags.single[_COMPRESSION],
        predictor=tags.single[_PREDICTOR],
        planar=tags.single[_PLANAR] == 2,
        segment_width=tags.single[_TILE_WIDTH] if tiled else width,
        segment_height=tags.single[_TILE_HEIGHT] if tiled else min(tags.single[_ROWS_PER_STRIP], height),
        tiled=tiled,
        offsets=tags.lists[_TILE_OFFSETS if tiled else _STRIP_OFFSETS],
        counts=tags.lists[_TILE_COUNTS if tiled else _STRIP_COUNTS],
    )
    _check_segments(layout)
    return layout


def _check_offered(single: Mapping[int, int], stored: np.dtype[Any]) -> None:
    if single[_COMPRESSION] not in COMPRESSIONS:
        raise UnknownFormat(
            f"TIFF with compression {single[_COMPRESSION]}; expected {', '.join(COMPRESSIONS.values())}"
        )
    if single[_SAMPLES] not in _CHANNELS.get(single[_PHOTOMETRIC], ()):
        raise UnknownFormat(
            f"TIFF with photometric interpretation {single[_PHOTOMETRIC]} and {single[_SAMPLES]} samples; "
            "expected grey (1) or RGB (2), with or without alpha"
        )
    predictors = (1, 2, 3) if stored.kind == "f" else (1, 2)
    # Readers disagree whether predictors apply where nothing, or PackBits, compresses.
    if single[_PREDICTOR] not in (predictors if single[_COMPRESSION] in PREDICTABLE else (1,)):
        raise UnknownFormat(
            f"TIFF of {stored.name}: compression {single[_COMPRESSION]}, predictor {single[_PREDICTOR]}; "
            "expected no predictor (1), or 2 or, for floats, 3 with LZW or deflate"
        )
    if single[_FILL_ORDER] != 1 or single[_PLANAR] not in (1, 2):
        raise UnknownFormat("TIFF with reversed bits or an unknown planar configuration; expected neither")


def _check_segments(layout: Layout) -> None:
    """Refuse strips or tiles whose number or size does not fit the image."""
    if layout.width < 1 or layout.height < 1:
        return  # refused with every other format, by `check_size`
    if layout.segment_width < 1 or layout.segment_height < 1:
        raise DamagedFile("the TIFF has strips or tiles without pixels")
    if not len(layout.offsets) == len(layout.counts) == layout.segments:
        raise DamagedFile(
            f"the TIFF lists {len(layout.offsets)} strips or tiles with {len(layout.counts)} sizes; "
            f"its {layout.width} x {layout.height} pixels need {layout.segments}"
        )
    # Tiles may hang over the border, but not by far more than the image itself.
    padded = layout.segments * layout.segment_width * layout.segment_height
    if layout.tiled and padded > 4 * layout.channels * layout.width * layout.height + (1 << 20):
        raise DamagedFile("the TIFF has tiles far larger than its image")
