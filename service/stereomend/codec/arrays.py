"""NPY: NumPy reads the header; the samples are taken from the bytes that came, nothing is unpickled."""

from __future__ import annotations

import io
from math import prod
from threading import Lock
from typing import Any

import numpy as np
from numpy.lib import format as npy

from stereomend.codec.headers import Header, Pixels, check_length
from stereomend.errors import DamagedFile, UnknownFormat

SIGNATURE = b"\x93NUMPY"

_LONGEST_HEADER = 10_000

# NumPy parses the header with `ast`, whose depth counter some Pythons share among threads: where a garbage
# collection lets another thread in, both fail with a SystemError.
_parsing = Lock()


def read_header(data: bytes) -> Header:
    """Read version, shape and dtype of an NPY file; any byte order, C or Fortran order.

    Raises:
        DamagedFile: the header is cut off or cannot be parsed.
        UnknownFormat: the array is not of bools, integers or floats of up to 8 bytes, or not (H, W) or
            (H, W, C).
    """
    shape, fortran, dtype, start = _parse(data)
    if dtype.kind not in "biuf" or dtype.itemsize > 8:
        raise UnknownFormat(f"NPY of {_described(dtype)}; expected integers or floats of 1 to 8 bytes")
    if len(shape) not in (2, 3):
        raise UnknownFormat(f"NPY with {len(shape)} axes; expected (H, W) or (H, W, 3)")
    channels = shape[2] if len(shape) == 3 else 1
    if len(shape) == 3 and channels != 3:
        raise UnknownFormat(f"NPY of shape {shape}; expected (H, W) or (H, W, 3)")

    def decode() -> Pixels:
        check_length("NPY", len(data), start + prod(shape) * dtype.itemsize)
        samples = np.frombuffer(data, dtype, prod(shape), start)
        if dtype.kind == "b":
            # A byte that is neither 0 nor 1 would be a bool that is neither.
            samples = samples.view(np.uint8) != 0
        return samples.reshape(shape, order="F" if fortran else "C").astype(
            dtype.newbyteorder("="), order="C"
        )

    return Header("NPY", shape[1], shape[0], channels, dtype.newbyteorder("="), decode)


def _parse(data: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any], int]:
    """Return shape, Fortran order, dtype and where the samples start."""
    file = io.BytesIO(data[: _LONGEST_HEADER + 12])
    try:
        version = npy.read_magic(file)
        # Version 3 differs from 2 only in how names of fields are encoded, and fields are refused.
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        with _parsing:
            shape, fortran, dtype = read(file, max_header_size=_LONGEST_HEADER)
    # literal_eval and dtype parsing raise many things on hostile headers.
    except Exception as error:
        raise DamagedFile("the NPY header is cut off or damaged") from error
    if not all(0 <= side < 1 << 62 for side in shape):
        raise DamagedFile("the NPY header promises a side that no array has")
    return shape, fortran, dtype, file.tell()


def _described(dtype: np.dtype[Any]) -> str:
    if dtype.hasobject:
        return "Python objects"
    return "records" if dtype.names or dtype.subdtype else dtype.name
