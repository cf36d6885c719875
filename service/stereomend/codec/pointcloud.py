"""PLY: a coloured point cloud, binary and little-endian."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Image, RefinementResult
from stereomend.errors import InvalidParameter

_PROPERTIES = (
    *(("x", "<f4"), ("y", "<f4"), ("z", "<f4")),
    *(("red", "u1"), ("green", "u1"), ("blue", "u1")),
    *(("confidence", "<f4"), ("provenance", "u1")),
)
_NAMES = {"<f4": "float", "u1": "uchar"}


def write_ply(result: RefinementResult, left: Image | None) -> bytes:
    """Write the pixels of known depth as points, row by row from the upper left.

    `x` right, `y` down, `z` forward of the left camera in mm; `red`, `green`, `blue` of the left image, 0 to
    255; `confidence` and `provenance` of the result.

    Args:
        result: maps of shape (H, W), with a depth map.
        left: the left image, uint8 or uint16, (H, W) or (H, W, 3) RGB.

    Raises:
        InvalidParameter: there is no calibration, or no image.
    """
    calibration = result.calibration
    if calibration is None or result.depth_mm is None or left is None:
        raise InvalidParameter("a point cloud needs focal_px, baseline_mm and the left image")
    known = result.depth_mm > 0
    points = calibration.points_mm(result.depth_mm)[known]
    vertices = np.empty(len(points), list(_PROPERTIES))
    vertices["x"], vertices["y"], vertices["z"] = points.T
    vertices["red"], vertices["green"], vertices["blue"] = _colours(left, known).T
    vertices["confidence"], vertices["provenance"] = result.confidence[known], result.provenance[known]
    return _header(len(vertices)) + vertices.tobytes()


def rgb8(image: Image) -> npt.NDArray[np.uint8]:
    """8-bit RGB, (H, W, 3), of an image, uint8 or uint16, (H, W) or (H, W, 1 or 3)."""
    samples = image if image.ndim == 3 else image[..., None]
    levels = samples if samples.dtype == np.uint8 else np.rint(samples / 257).astype(np.uint8)
    return np.broadcast_to(levels, (*levels.shape[:2], 3))


def _colours(left: Image, known: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint8]:
    """8-bit RGB of the chosen pixels, (N, 3)."""
    colours: npt.NDArray[np.uint8] = rgb8((left if left.ndim == 3 else left[..., None])[None, known])[0]
    return colours


def _header(count: int) -> bytes:
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment millimetres; left camera: x right, y down, z forward",
        f"element vertex {count}",
        *(f"property {_NAMES[kind]} {name}" for name, kind in _PROPERTIES),
        "end_header\n",
    ]
    return "\n".join(lines).encode()
