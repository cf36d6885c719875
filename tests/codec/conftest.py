"""Files packed by hand or by other writers; nothing here uses the code under test."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Sequence

import numpy as np
import pytest
import tifffile

ADAM7 = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


class PngWriter:
    """Packs PNG files by the specification; `samples` has shape (H, W) or (H, W, C)."""

    chunk = staticmethod(_chunk)

    @staticmethod
    def ihdr(width: int, height: int, depth: int = 8, colour: int = 0, interlace: int = 0) -> bytes:
        fields = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, interlace)
        return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", fields)

    @staticmethod
    def rows(samples: np.ndarray, depth: int) -> bytes:
        if depth == 16:
            return b"".join(b"\0" + row.astype(">u2").tobytes() for row in samples)
        if depth == 8:
            return b"".join(b"\0" + row.astype(np.uint8).tobytes() for row in samples)
        bits = (samples[..., None].astype(np.uint8) >> np.arange(depth - 1, -1, -1)) & 1
        return b"".join(b"\0" + np.packbits(row.reshape(-1)).tobytes() for row in bits)

    def __call__(
        self, samples: np.ndarray, depth: int = 8, colour: int = 0, before: bytes = b"", piece: int = 1 << 30
    ) -> bytes:
        samples = np.asarray(samples)
        header = self.ihdr(samples.shape[1], samples.shape[0], depth, colour)
        return header + before + self.body(self.rows(samples, depth), piece)

    def interlaced(self, samples: np.ndarray, depth: int = 8, colour: int = 0, before: bytes = b"") -> bytes:
        passes = [samples[y::dy, x::dx] for y, x, dy, dx in ADAM7]
        rows = b"".join(self.rows(part, depth) for part in passes if part.size)
        return self.ihdr(samples.shape[1], samples.shape[0], depth, colour, 1) + before + self.body(rows)

    @staticmethod
    def body(rows: bytes, piece: int = 1 << 30) -> bytes:
        packed = zlib.compress(rows)
        parts = [_chunk(b"IDAT", packed[at : at + piece]) for at in range(0, len(packed), piece)]
        return b"".join(parts) + _chunk(b"IEND", b"")


@pytest.fixture(scope="session")
def png() -> PngWriter:
    return PngWriter()


@pytest.fixture(scope="session")
def npy() -> Callable[[np.ndarray], bytes]:
    def write(array: np.ndarray) -> bytes:
        file = io.BytesIO()
        np.save(file, array, allow_pickle=True)
        return file.getvalue()

    return write


@pytest.fixture(scope="session")
def tiff() -> Callable[..., bytes]:
    def write(*pages: np.ndarray, **options: object) -> bytes:
        file = io.BytesIO()
        how = {name: options.pop(name) for name in ("bigtiff", "byteorder") if name in options}
        with tifffile.TiffWriter(file, **how) as writer:
            for page in pages:
                writer.write(page, metadata=None, **options)
        return file.getvalue()

    return write


@pytest.fixture(scope="session")
def raw_tiff() -> Callable[..., bytes]:
    """Packs a little-endian TIFF from (tag, type, values), with `pixels` right behind the directory."""

    def write(
        tags: Sequence[tuple[int, int, Sequence[int]]], pixels: bytes = b"", following: int = 0
    ) -> bytes:
        formats = {1: "B", 3: "H", 4: "I", 16: "Q"}
        extra_at, extra, entries = 8 + 2 + 12 * len(tags) + 4, b"", b""
        for code, kind, values in tags:
            packed = struct.pack(f"<{len(values)}{formats[kind]}", *values)
            if len(packed) > 4:
                packed, extra = struct.pack("<I", extra_at + len(extra)), extra + packed
            entries += struct.pack("<HHI", code, kind, len(values)) + packed.ljust(4, b"\0")
        directory = struct.pack("<H", len(tags)) + entries + struct.pack("<I", following)
        return b"II*\0" + struct.pack("<I", 8) + directory + extra + pixels

    return write


@pytest.fixture(scope="session")
def pfm() -> Callable[..., bytes]:
    def write(rows_from_the_top: np.ndarray, scale: str = "-1.0", kind: str = "Pf") -> bytes:
        order = "<" if scale.startswith("-") else ">"
        height, width = rows_from_the_top.shape[:2]
        samples = b"".join(row.astype(order + "f4").tobytes() for row in reversed(rows_from_the_top))
        return f"{kind}\n{width} {height}\n{scale}\n".encode() + samples

    return write


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(7)
