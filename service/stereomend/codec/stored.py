"""The stored form of a result: all of it in one NPZ, from which every media type can be made later."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from stereomend.codec.pointcloud import rgb8
from stereomend.codec.results import (
    PLY_TYPE,
    ZIP_TYPE,
    choose_outputs,
    encode_map,
    encode_result,
    write_npz,
)
from stereomend.disparity import Image, RefinementResult
from stereomend.errors import InternalError

STORED_TYPE = "application/zip; profile=stored"
"""A zip of all arrays and, if calibrated, of `left`: uint8 (H, W, 3) RGB, the colours of a point cloud."""

_LEFT = "left"
_META = "meta"


def encode_stored(result: RefinementResult, left: Image, outputs: Sequence[str] | None = None) -> bytes:
    """Write all of a result; `left` as in `encode_result`.

    Raises:
        InvalidParameter: one of `outputs`, which will be asked for later, is not there.
    """
    colours = {} if result.calibration is None else {_LEFT: rgb8(left)}
    choose_outputs(result, outputs)
    return write_npz(result, None, colours)


def render(stored: bytes, media_type: str, outputs: Sequence[str] | None = None) -> bytes:
    """Write a stored result in one of the formats offered, byte for byte as `encode_result` would have.

    Args:
        stored: what `encode_stored` wrote.
        media_type: as of `encode_result`.
        outputs: the arrays of a zip; None: all.

    Raises:
        NotAcceptable, InvalidParameter, DisparityOutOfRange: as `encode_result`.
        InternalError: the stored result cannot be read.
    """
    if media_type not in (ZIP_TYPE, PLY_TYPE):
        return encode_map(_load(stored, ("disparity",))["disparity"], media_type)
    arrays = _load(stored)
    left = arrays.pop(_LEFT, None)
    meta = json.loads(str(arrays.pop(_META)))
    result = RefinementResult(**arrays, timings=meta.pop("timings_ms"), meta=meta)
    return encode_result(result, media_type, outputs, left)


def _load(stored: bytes, names: Sequence[str] | None = None) -> dict[str, npt.NDArray[Any]]:
    try:
        _check_members(stored)
        with np.load(io.BytesIO(stored), allow_pickle=False) as archive:
            chosen: Mapping[str, npt.NDArray[Any]] = archive
            return {name: chosen[name] for name in names or archive.files}
    except (ValueError, OSError, KeyError, zipfile.BadZipFile) as error:
        raise InternalError(f"the stored result cannot be read: {error}") from error


def _check_members(stored: bytes) -> None:
    # A worker that a hostile file took over may have written it: it must not unfold into more than there is.
    with zipfile.ZipFile(io.BytesIO(stored)) as archive:
        for member in archive.infolist():
            if member.compress_type != zipfile.ZIP_STORED or member.file_size > len(stored):
                raise ValueError(f"{member.filename!r} is compressed or too large")
