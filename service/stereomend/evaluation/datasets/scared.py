"""SCARED keyframes: pairs of porcine cadavers with structured light, not rectified.

M. Allan et al., "Stereo correspondence and reconstruction of endoscopic data challenge", arXiv:2101.01133.
`left_depth_map.tiff` has X, Y and Z in mm for each pixel of the left image as it was taken, NaN where
unknown.

Pairs and truth are rectified here with OpenCV's `stereoRectify(..., flags=CALIB_ZERO_DISPARITY, alpha=0)` at
the size of the images, so predictions have to be made on pairs that were rectified in the same way.
"""

from __future__ import annotations

import io
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import tifffile

from stereomend.codec.headers import named
from stereomend.disparity import Calibration, DisparityMap, FloatMap, Image, check_same_size
from stereomend.errors import DamagedFile, TooManyPixels, UnknownFormat
from stereomend.evaluation.files import Reader, find, need
from stereomend.evaluation.frame import Entry, Frame
from stereomend.evaluation.projection import calibration_of
from stereomend.opencv import cv2

_FILES = ("Right_Image.png", "left_depth_map.tiff", "endoscope_calibration.yaml")
_MATRICES = {"M1": (3, 3), "D1": (-1,), "M2": (3, 3), "D2": (-1,), "R": (3, 3), "T": (3, 1)}

Real = npt.NDArray[np.float64]


class _Rectification(NamedTuple):
    """Where each pixel of the rectified images comes from, and the cameras that would have taken them."""

    left_maps: tuple[FloatMap, FloatMap]
    """Columns and rows in the left image as taken, (H, W) px each."""
    right_maps: tuple[FloatMap, FloatMap]
    rotation: Real
    """From the left camera as it was to the rectified one, (3, 3)."""
    calibration: Calibration


def entries(root: Path, read: Reader) -> list[Entry]:
    """List the keyframes, such as `dataset_1/keyframe_2` (raises UnknownFormat where a file is missing)."""
    folders = [path.parent for path in find(root, "dataset*/keyframe*/Left_Image.png")]
    for folder in folders:
        for name in _FILES:
            need(folder / name)
    return [Entry(f"{one.parent.name}/{one.name}", partial(_load, one, read)) for one in folders]


def _load(folder: Path, read: Reader) -> Frame:
    left, right = read.image(folder / "Left_Image.png"), read.image(folder / "Right_Image.png")
    points = _read_points(folder / "left_depth_map.tiff", read)
    check_same_size("left_depth_map.tiff", points.shape, "Left_Image.png", left.shape)
    calibration = folder / "endoscope_calibration.yaml"
    with named(str(calibration)):
        rectified = _rectify(_parse_cameras(calibration.read_text()), (left.shape[1], left.shape[0]))
    return Frame(
        _warp(left, rectified.left_maps),
        _warp(right, rectified.right_maps),
        _truth(points, rectified),
        calibration=rectified.calibration,
    )


def _read_points(path: Path, read: Reader) -> Real:
    """X, Y, Z in mm, (H, W, 3)."""
    with named(str(path)), tifffile.TiffFile(io.BytesIO(path.read_bytes())) as file:
        series = file.series[0]
        if len(series.shape) != 3 or series.shape[2] != 3:
            raise UnknownFormat(f"shape {series.shape}; expected X, Y and Z of shape (H, W, 3)")
        if series.shape[0] * series.shape[1] > read.max_pixels:
            raise TooManyPixels(
                f"{series.shape[1]} x {series.shape[0]} pixels; at most {read.max_pixels} are read"
            )
        return np.asarray(series.asarray(), np.float64)


def _parse_cameras(text: str) -> dict[str, Real]:
    """Intrinsics M, distortion D, and R, T with `X_right = R X_left + T` in mm, as OpenCV writes them."""
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        found: dict[str, Any] = {name: storage.getNode(name).mat() for name in _MATRICES}
        return {name: np.asarray(found[name], np.float64).reshape(_MATRICES[name]) for name in _MATRICES}
    except (cv2.error, SystemError, ValueError, TypeError) as error:
        raise DamagedFile(f"expected OpenCV YAML with {', '.join(_MATRICES)}") from error


def _rectify(cameras: dict[str, Real], size: tuple[int, int]) -> _Rectification:
    lens = {side: (cameras[f"M{side}"], cameras[f"D{side}"]) for side in "12"}
    r1, r2, p1, p2, *_ = cv2.stereoRectify(
        *lens["1"],
        *lens["2"],
        size,
        cameras["R"],
        cameras["T"],
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0,
    )
    left, right = (
        cv2.initUndistortRectifyMap(*lens[side], rotation, projection, size, cv2.CV_32FC1)
        for side, rotation, projection in (("1", r1, p1), ("2", r2, p2))
    )
    calibration = calibration_of(np.asarray(p1, np.float64), np.asarray(p2, np.float64))
    return _Rectification(
        (_single(left[0]), _single(left[1])),
        (_single(right[0]), _single(right[1])),
        np.asarray(r1, np.float64),
        calibration,
    )


def _single(plane: Any) -> FloatMap:
    return np.asarray(plane, np.float32)


def _warp(image: Image, maps: tuple[FloatMap, FloatMap]) -> Image:
    warped: Any = cv2.remap(image, *maps, cv2.INTER_LINEAR)
    return np.asarray(warped, np.uint8) if image.dtype == np.uint8 else np.asarray(warped, np.uint16)


def _truth(points: Real, rectified: _Rectification) -> FloatMap:
    """Disparity of the rectified left image, (H, W) px.

    It is computed where the points are and then interpolated: on a plane disparity is linear in the image,
    depth is not. Beside an unknown point it is unknown.
    """
    depth = points @ rectified.rotation[2]
    known = rectified.calibration
    with np.errstate(divide="ignore", invalid="ignore"):
        disparity = np.where(depth > 0, known.focal_px * known.baseline_mm / depth - known.doffs, np.nan)
    moved = cv2.remap(
        disparity.astype(np.float32), *rectified.left_maps, cv2.INTER_LINEAR, borderValue=(np.nan,)
    )
    return DisparityMap.from_array(np.asarray(moved)).values
