"""Small sound files of every format that is read, as many writers write them."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import tifffile

Random = np.random.Generator
Array = npt.NDArray[Any]

WIDTH, HEIGHT = 64, 48
"""Of the largest file [px]."""

_ADAM7 = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))


class Format(NamedTuple):
    """What a file is uploaded as, and how its bytes are laid out."""

    part: str
    """`image`, `map` or `mask`."""
    container: str
    """`png`, `jpeg`, `tiff`, `bmp`, `pnm`, `npy` or `pfm`."""

    def __str__(self) -> str:
        return f"{self.part} {self.container}"


class Original(NamedTuple):
    """A sound file, and its height and width."""

    data: bytes
    shape: tuple[int, int]


@cache
def originals(format: Format) -> tuple[Original, ...]:
    """One file for each way this format is written and each of three sizes, the largest 64 x 48."""
    return tuple(Original(write(scene), scene.shape[:2]) for write in _WRITERS[format] for scene in _scenes())


def _scenes() -> list[Array]:
    """Three pictures, uint8 (H, W, 3)."""
    random = np.random.default_rng(7)
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    ramp = np.stack([rows * 3, columns * 2, rows + columns], axis=-1)
    whole = (ramp + random.integers(1, 30, (HEIGHT, WIDTH, 3))).astype(np.uint8)
    return [whole, whole[:17, :31], whole[:1, :3]]


def _grey(image: Array) -> Array:
    return np.ascontiguousarray(image[:, :, 0])


def _disparity(image: Array) -> Array:
    return _grey(image) / np.float32(16)


def png_chunk(kind: bytes, body: bytes) -> bytes:
    """Length, name, body and checksum."""
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def _png(depth: int, colour: int, interlaced: bool = False, before: bytes = b"") -> Callable[[Array], bytes]:
    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[colour]

    def write(image: Array) -> bytes:
        eight = np.concatenate([image, image[:, :, :1]], axis=2)[:, :, :channels]
        samples = eight * np.uint16(256) if depth == 16 else eight >> (8 - depth)
        passes = _ADAM7 if interlaced else ((0, 0, 1, 1),)
        rows = b"".join(
            b"\0" + _packed(row, depth)
            for y, x, step_y, step_x in passes
            for row in samples[y::step_y, x::step_x]
            if row.size
        )
        ihdr = struct.pack(">IIBBBBB", image.shape[1], image.shape[0], depth, colour, 0, 0, interlaced)
        palette = png_chunk(b"PLTE", bytes(range(256)) * 3) if colour == 3 else b""
        chunks = (png_chunk(b"IHDR", ihdr), before, palette, png_chunk(b"IDAT", zlib.compress(rows)))
        return b"\x89PNG\r\n\x1a\n" + b"".join(chunks) + png_chunk(b"IEND", b"")

    return write


def _packed(row: Array, depth: int) -> bytes:
    if depth >= 8:
        return row.astype(">u2" if depth == 16 else np.uint8).tobytes()
    bits = (row.reshape(-1)[:, None] >> np.arange(depth - 1, -1, -1)) & 1
    return np.packbits(bits.astype(np.uint8).reshape(-1)).tobytes()


def _opencv(ending: str, *options: int, grey: bool = False) -> Callable[[Array], bytes]:
    return lambda image: bytes(cv2.imencode(ending, _grey(image) if grey else image, options)[1])


def _bmp32(image: Array) -> bytes:
    height, width = image.shape[:2]
    pixels = np.concatenate([image[::-1], image[::-1, :, :1]], axis=2).tobytes()
    header = struct.pack("<IHHIIiiHHIIiiII", 54 + len(pixels), 0, 0, 54, 40, width, height, 1, 32, *6 * [0])
    return b"BM" + header + pixels


def _pnm(kind: str, largest: int, comment: str = "") -> Callable[[Array], bytes]:
    def write(image: Array) -> bytes:
        samples = _grey(image) if kind == "P5" else image
        head = f"{kind}\n{comment}{image.shape[1]} {image.shape[0]}\n{largest}\n".encode()
        return head + samples.astype(">u2" if largest > 255 else np.uint8).tobytes()

    return write


def _npy(dtype: str, view: Callable[[Array], Array] = _grey, order: Any = "C") -> Callable[[Array], bytes]:
    def write(image: Array) -> bytes:
        file = io.BytesIO()
        np.save(file, np.asarray(view(image).astype(dtype), order=order))
        return file.getvalue()

    return write


def _npy_version(version: tuple[int, int]) -> Callable[[Array], bytes]:
    def write(image: Array) -> bytes:
        file = io.BytesIO()
        np.lib.format.write_array(file, image, version=version)
        return file.getvalue()

    return write


def _pfm(order: str) -> Callable[[Array], bytes]:
    def write(image: Array) -> bytes:
        head = f"Pf\n{image.shape[1]} {image.shape[0]}\n{'-1.0' if order == '<' else '1.0'}\n".encode()
        return head + _disparity(image)[::-1].astype(f"{order}f4").tobytes()

    return write


def _tiff(
    view: Callable[[Array], Array], byteorder: Literal["<", ">"] = "<", **how: Any
) -> Callable[[Array], bytes]:
    def write(image: Array) -> bytes:
        file = io.BytesIO()
        with tifffile.TiffWriter(file, byteorder=byteorder) as writer:
            writer.write(view(image), metadata=None, **how)
        return file.getvalue()

    return write


def _packbits(image: Array) -> bytes:
    """Every row one literal run."""
    packed = b"".join(bytes([image.shape[1] - 1]) + row.tobytes() for row in _grey(image))
    return _one_strip(image, packed, {258: 8, 259: 32773})


def _float_predictor(image: Array) -> bytes:
    """Of each row the differences of its bytes, all most significant ones first, deflated."""
    values = _disparity(image).astype(">f4")
    rows = values.view(np.uint8).reshape(*values.shape, 4).transpose(0, 2, 1).reshape(len(values), -1)
    packed = zlib.compress(np.diff(rows, axis=1, prepend=np.uint8(0)).tobytes())
    return _one_strip(image, packed, {258: 32, 259: 8, 317: 3, 339: 3})


def _one_strip(image: Array, packed: bytes, more: Mapping[int, int]) -> bytes:
    height, width = image.shape[:2]
    tags = {256: width, 257: height, 262: 1, 277: 1, 278: height, 279: len(packed), **more}
    tags[273] = 8 + 2 + 12 * (len(tags) + 1) + 4
    entries = b"".join(struct.pack("<HHII", code, 4, 1, tags[code]) for code in sorted(tags))
    return struct.pack("<4sIH", b"II*\0", 8, len(tags)) + entries + bytes(4) + packed


def _planes(image: Array) -> Array:
    return np.ascontiguousarray(np.moveaxis(image, 2, 0))


_TEXT = png_chunk(b"tEXt", b"Comment\0" + b"harmless " * 20)
_TIFF_LZW = (cv2.IMWRITE_TIFF_COMPRESSION, 5)

_WRITERS: Mapping[Format, tuple[Callable[[Array], bytes], ...]] = {
    Format("image", "png"): (
        _png(8, 0),
        _png(16, 2),
        _png(8, 2, interlaced=True, before=_TEXT),
        _png(8, 3),
        _png(4, 3, interlaced=True),
        _png(8, 6),
        _png(16, 4, before=_TEXT),
        _png(1, 0),
        _opencv(".png"),
    ),
    Format("image", "jpeg"): (
        _opencv(".jpg"),
        _opencv(".jpg", grey=True),
        _opencv(".jpg", cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
        _opencv(".jpg", cv2.IMWRITE_JPEG_RST_INTERVAL, 2, cv2.IMWRITE_JPEG_OPTIMIZE, 1),
        _opencv(".jpg", cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
    ),
    Format("image", "tiff"): (
        _tiff(np.asarray, rowsperstrip=7, photometric="rgb"),
        _tiff(np.asarray, tile=(16, 16), compression="zlib", predictor=True, photometric="rgb"),
        _tiff(_planes, ">", planarconfig="separate", photometric="rgb"),
        _tiff(lambda image: _grey(image).astype(np.uint16) * 256, ">"),
        _opencv(".tiff", *_TIFF_LZW),
        _packbits,
    ),
    Format("image", "bmp"): (_opencv(".bmp"), _opencv(".bmp", grey=True), _bmp32),
    Format("image", "pnm"): (
        _pnm("P5", 255),
        _pnm("P6", 255, "# of a camera\n"),
        _pnm("P5", 65535),
        _pnm("P6", 65535),
    ),
    Format("image", "npy"): (
        _npy("u1", np.asarray),
        _npy("u1"),
        _npy(">u2", np.asarray),
        _npy("<u2", order="F"),
        _npy_version((2, 0)),
    ),
    Format("map", "png"): (_png(16, 0), _png(16, 0, interlaced=True), _opencv(".png", grey=True)),
    Format("map", "npy"): (
        _npy("<f4", _disparity),
        _npy(">f8", _disparity, "F"),
        _npy("<f2", _disparity),
        _npy("<i4"),
        _npy("<u8"),
    ),
    Format("map", "pfm"): (_pfm("<"), _pfm(">")),
    Format("map", "tiff"): (
        _tiff(_disparity),
        _tiff(_disparity, ">", compression="zlib", rowsperstrip=5),
        _float_predictor,
        _tiff(lambda image: _disparity(image).astype(np.float64), tile=(16, 16)),
        _tiff(lambda image: _grey(image).astype(np.uint16), compression="zlib"),
        _packbits,
    ),
    Format("mask", "png"): (_png(8, 0), _png(1, 0), _png(8, 4), _png(2, 0, interlaced=True)),
    Format("mask", "npy"): (_npy("?"), _npy("u1"), _npy(">u2", order="F")),
    Format("mask", "tiff"): (
        _tiff(_grey),
        _tiff(_grey, compression="zlib"),
        _opencv(".tiff", *_TIFF_LZW, grey=True),
    ),
    Format("mask", "bmp"): (_opencv(".bmp", grey=True),),
    Format("mask", "pnm"): (_pnm("P5", 255), _pnm("P5", 65535)),
}

FORMATS = tuple(_WRITERS)
"""All formats that are read, of images, maps and masks."""
