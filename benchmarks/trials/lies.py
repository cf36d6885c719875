"""Edits that know a container: fields of headers set to plausible lies, and pieces that can be repeated."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from trials.originals import Random, png_chunk

NUMBERS = (
    *(0, 1, 2, 3, 4, 7, 8, 15, 16, 17, 24, 31, 32, 33, 47, 48, 49, 63, 64, 65, 127, 128, 255, 256, 257),
    *(1000, 3999, 4000, 4096, 16384, 32767, 32768, 65500, 65535, 65536, 1 << 20, 1 << 24, 1 << 28),
    *((1 << 31) - 1, 1 << 31, (1 << 32) - 1),
)
"""What fields and tokens are set to: sides of images, bits, and where arithmetic may overflow."""

_CHUNK_NAMES = (b"IHDR", b"PLTE", b"IDAT", b"IEND", b"tRNS", b"gAMA", b"iCCP", b"acTL", b"fdAT", b"CgBI")
_DTYPES = (
    *(b"|u1", b"<u2", b">u2", b"<u4", b"<i8", b"|b1", b"<f2", b"<f4", b">f8", b"<f16", b"<c8", b"|O"),
    *(b"<M8[s]", b"|V4", b"|S3", b"<U0", b"|u0", b"<f9", b"u1,u2", b"3u1"),
)


class Field(NamedTuple):
    """A number in a header: `form` is its `struct` format."""

    at: int
    form: str


def fields(container: str, data: bytes) -> list[Field]:
    """The numbers of a binary header, as far as it is whole."""
    found = list(_FIELDS[container](data)) if container in _FIELDS else []
    return [field for field in found if field.at + struct.calcsize(field.form) <= len(data)]


def lie(container: str, data: bytes, random: Random) -> bytes:
    """Set a field to a number that may stand there, or to one near the one that does."""
    if container in _TEXTS:
        return _reword(container, data, random)
    places = fields(container, data)
    if not places:
        return data
    field = places[random.integers(len(places))]
    (now,) = struct.unpack_from(field.form, data, field.at)
    near = (now - 1, now + 1, 2 * now, now // 2, -now)
    chosen = int(random.choice(near if random.random() < 0.3 else NUMBERS))
    size = struct.calcsize(field.form)
    lied = struct.pack(field.form.upper(), chosen % (1 << 8 * size))
    return data[: field.at] + lied + data[field.at + size :]


def repeat(container: str, data: bytes, random: Random) -> bytes:
    """Insert a chunk, segment, directory entry or range a second to a hundredth time."""
    if container == "tiff" and random.random() < 0.7:
        return _repeat_entries(data, random)
    bounds = _BOUNDS.get(container, _anywhere)(data)
    if len(bounds) < 2:
        return data
    first = int(random.integers(len(bounds) - 1))
    last = int(random.integers(first + 1, min(len(bounds), first + 4)))
    piece = data[bounds[first] : bounds[last]]
    times = int(random.choice((1, 1, 2, 5, 40, 100)))
    target = bounds[random.integers(len(bounds))]
    return data[:target] + piece * (times if len(piece) * times < 1 << 18 else 1) + data[target:]


def seal(container: str, data: bytes) -> bytes:
    """Make damage pass the first check: the checksums of a PNG fit again."""
    return _sealed(data) if container == "png" else data


def repack(data: bytes, random: Random) -> bytes:
    """Change some bytes of a PNG's filtered rows, or their number, before they are compressed."""
    chunks = list(_png_chunks(data))
    pixels = b"".join(data[at + 8 : end - 4] for at, end in chunks if data[at + 4 : at + 8] == b"IDAT")
    try:
        rows = bytearray(zlib.decompress(pixels))
    except zlib.error:
        return data
    for _ in range(random.integers(1, 20)):
        if rows:
            rows[random.integers(len(rows))] = random.integers(256)
    grown = bytes(rows) + bytes(int(random.choice((0, 0, 0, 1, 1000, 1 << 22))))
    idat = png_chunk(b"IDAT", zlib.compress(grown[: len(grown) - int(random.choice((0, 0, 0, 1, 60)))], 1))
    rest = [(at, end) for at, end in chunks if data[at + 4 : at + 8] not in (b"IDAT", b"IEND")]
    return data[:8] + b"".join(data[at:end] for at, end in rest) + idat + png_chunk(b"IEND", b"")


def _png_chunks(data: bytes) -> Iterator[tuple[int, int]]:
    at = 8
    while at + 12 <= len(data):
        end = at + 12 + int.from_bytes(data[at : at + 4], "big")
        if end > len(data):
            return
        yield at, end
        at = end


def _png_fields(data: bytes) -> Iterator[Field]:
    yield from (Field(at, form) for at, form in ((16, ">I"), (20, ">I"), (16, ">I"), (20, ">I")))
    yield from (Field(at, "B") for at in range(24, 29))
    for at, end in _png_chunks(data):
        yield Field(at, ">I")
        if data[at + 4 : at + 8] == b"PLTE":
            yield Field(at + 8, ">H")
        if end > at + 12:
            yield Field(at + 8, "B")


def _sealed(data: bytes) -> bytes:
    parts, at = [data[:8]], 8
    while at + 12 <= len(data):
        end = at + 8 + min(int.from_bytes(data[at : at + 4], "big"), len(data))
        parts += [data[at:end], zlib.crc32(data[at + 4 : end]).to_bytes(4, "big")]
        at = end + 4
    return b"".join(parts)


def rename_chunk(data: bytes, random: Random) -> bytes:
    """Give a chunk of a PNG another name."""
    chunks = list(_png_chunks(data))
    if not chunks:
        return data
    at = chunks[random.integers(len(chunks))][0] + 4
    return data[:at] + _CHUNK_NAMES[random.integers(len(_CHUNK_NAMES))] + data[at + 4 :]


def _jpeg_segments(data: bytes) -> Iterator[tuple[int, int]]:
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        end = at + 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        if data[at + 1] == 0xDA:
            following = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]").search(data, end)
            end = following.start() if following else len(data)
        yield at, min(end, len(data))
        at = end


def _jpeg_fields(data: bytes) -> Iterator[Field]:
    for at, end in _jpeg_segments(data):
        marker = data[at + 1]
        yield Field(at + 1, "B")
        yield Field(at + 2, ">H")
        if 0xC0 <= marker <= 0xC2:
            yield from (Field(at + 5, ">H"), Field(at + 7, ">H"), Field(at + 5, ">H"), Field(at + 7, ">H"))
        if marker == 0xDD:
            yield Field(at + 4, ">H")
        yield from (Field(here, "B") for here in range(at + 4, min(end, at + 24)))


def _tiff_order(data: bytes) -> str:
    return "<" if data[:2] == b"II" else ">"


def _tiff_entries(data: bytes) -> list[int]:
    order = _tiff_order(data)
    if len(data) < 10:
        return []
    (start,) = struct.unpack_from(order + "I", data, 4)
    if start + 2 > len(data):
        return []
    (count,) = struct.unpack_from(order + "H", data, start)
    return [at for at in range(start + 2, start + 2 + 12 * count, 12) if at + 12 <= len(data)]


def _tiff_fields(data: bytes) -> Iterator[Field]:
    order, entries = _tiff_order(data), _tiff_entries(data)
    yield Field(4, order + "I")
    if entries:
        yield Field(entries[0] - 2, order + "H")
        yield Field(entries[-1] + 12, order + "I")
    for at in entries:
        yield from (Field(at, order + "H"), Field(at + 2, order + "H"), Field(at + 4, order + "I"))
        kind, count = struct.unpack_from(order + "HI", data, at + 2)
        form = order + ("H" if kind == 3 else "I")
        inside = count * (2 if kind == 3 else 4) <= 4
        yield from 3 * [Field(at + 8, form)]
        if not inside:
            (place,) = struct.unpack_from(order + "I", data, at + 8)
            yield from (
                Field(place + number * struct.calcsize(form), form) for number in range(min(count, 3))
            )


def _repeat_entries(data: bytes, random: Random) -> bytes:
    """Write the directory again at the end, some entries doubled, dropped or swapped."""
    order, places = _tiff_order(data), _tiff_entries(data)
    entries = [data[at : at + 12] for at in places]
    if not entries:
        return data
    for _ in range(random.integers(1, 4)):
        first, second = random.integers(len(entries), size=2)
        match random.integers(3):
            case 0:
                entries.insert(first, entries[second])
            case 1:
                entries[first] = entries[second][:2] + entries[first][2:]
            case _ if len(entries) > 1:
                del entries[first]
    directory = struct.pack(order + "H", len(entries)) + b"".join(entries) + bytes(4)
    return data[:4] + struct.pack(order + "I", len(data)) + data[8:] + directory


def _bmp_fields(data: bytes) -> Iterator[Field]:
    sides = [Field(18, "<I"), Field(22, "<I")]
    yield from (Field(2, "<I"), Field(10, "<I"), Field(14, "<I"), *sides, *sides, Field(26, "<H"))
    yield from (Field(28, "<H"), Field(28, "<H"), *(Field(at, "<I") for at in (30, 34, 46, 50)))


def _npy_fields(data: bytes) -> Iterator[Field]:
    yield from (Field(6, "B"), Field(7, "B"), Field(8, "<H"))


def _reword(container: str, data: bytes, random: Random) -> bytes:
    """Replace a word of a text header."""
    words = list(_TEXTS[container].finditer(data[:400]))
    if not words or (container == "npy" and random.random() < 0.1):
        return _set(data, list(_npy_fields(data)), random) if container == "npy" else data
    word = words[random.integers(len(words))]
    return data[: word.start()] + _another(word[0], random) + data[word.end() :]


def _set(data: bytes, places: list[Field], random: Random) -> bytes:
    field = places[random.integers(len(places))]
    size = struct.calcsize(field.form)
    number = int(random.choice(NUMBERS)) % (1 << 8 * size)
    return data[: field.at] + struct.pack(field.form, number) + data[field.at + size :]


def _another(word: bytes, random: Random) -> bytes:
    if word.isdigit() and random.random() < 0.9:
        near = (int(word) - 1, int(word) + 1, 2 * int(word), -int(word))
        return str(random.choice(near if random.random() < 0.3 else NUMBERS)).encode()
    if word[:1] in b"|<>":
        return _DTYPES[random.integers(len(_DTYPES))]
    others = (
        b"True",
        b"False",
        b"None",
        b"()",
        b"1e9",
        b"-0.0",
        b"nan",
        b"inf",
        b"#",
        b"\xa0",
        b"{",
        b"(" * 90,
    )
    return others[random.integers(len(others))]


def _anywhere(data: bytes) -> list[int]:
    return list(range(0, len(data) + 1, max(1, len(data) // 16)))


def _bounds(pieces: Callable[[bytes], Iterator[tuple[int, int]]]) -> Callable[[bytes], list[int]]:
    return lambda data: sorted({place for piece in pieces(data) for place in piece})


_TEXTS: Mapping[str, re.Pattern[bytes]] = {
    "pnm": re.compile(rb"(?<![\w.])\d+(?![\w.])|P[56]"),
    "pfm": re.compile(rb"(?<![\w.])-?\d+(?:\.\d+)?(?![\w.])|P[fF]"),
    "npy": re.compile(rb"(?<![\w.])\d+(?![\w.])|True|False|[|<>][a-z]\d+|shape|descr"),
}
_FIELDS: Mapping[str, Callable[[bytes], Iterator[Field]]] = {
    "png": _png_fields,
    "jpeg": _jpeg_fields,
    "tiff": _tiff_fields,
    "bmp": _bmp_fields,
}
_BOUNDS: Mapping[str, Callable[[bytes], list[int]]] = {
    "png": _bounds(_png_chunks),
    "jpeg": _bounds(_jpeg_segments),
}
