"""Deflate as zlib writes and reads it, by ISA-L where it is there: two to three times as fast, as small."""

from __future__ import annotations

import zlib
from typing import Protocol

Buffer = bytes | bytearray | memoryview


class Inflater(Protocol):
    """As `zlib.decompressobj`."""

    @property
    def eof(self) -> bool:
        """The stream has ended."""
        ...

    def decompress(self, data: Buffer, max_length: int, /) -> bytes:
        """Inflate at most `max_length` bytes (raises one of `ERRORS`)."""
        ...


ERRORS: tuple[type[Exception], ...] = (zlib.error,)
"""What an inflater raises where the data are damaged."""

try:
    from isal import isal_zlib
except ImportError:  # there are no wheels for some processors

    def inflater() -> Inflater:
        """Start to inflate a zlib stream."""
        return zlib.decompressobj()

    def deflated(data: Buffer) -> bytes:
        """A zlib stream, written fast rather than small."""
        return zlib.compress(data, 1)

    crc32 = zlib.crc32
else:
    ERRORS = (isal_zlib.error,)  # type: ignore[assignment]  # its stub calls the class an instance

    def inflater() -> Inflater:
        """Start to inflate a zlib stream."""
        return isal_zlib.decompressobj()

    def deflated(data: Buffer) -> bytes:
        """A zlib stream, written fast rather than small."""
        return isal_zlib.compress(data, 1)

    crc32 = isal_zlib.crc32
