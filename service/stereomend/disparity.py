"""What goes into a refinement and what comes out: plain data, NumPy only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt

from stereomend.errors import InvalidParameter, ShapeMismatch, UnknownFormat

FloatMap = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]
Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


class Provenance(IntEnum):
    """Where a returned value comes from; where several apply, the highest is stored."""

    KEPT = 0
    """Within 0.5 px of the upload."""
    REFINED = 1
    """Moved by the global refinement."""
    FILLED = 2
    """Unknown in the upload, or replaced by the local refinement."""
    UNOBSERVED = 3
    """Not visible in the right image, outside it or occluded, or not part of the scene."""


@dataclass(frozen=True)
class StereoPair:
    """A rectified pair: two uint8 or uint16 images of shape (H, W) or (H, W, 3), RGB.

    Raises:
        UnknownFormat: an array has another dtype, number of axes or channels, or no pixel.
        ShapeMismatch: two of them differ in height or width.
        InvalidParameter: the mask leaves no pixel of the scene.
    """

    left: Image
    right: Image
    mask: Mask | None = None
    """Which pixels of the left image show the scene, bool (H, W); None: all."""

    def __post_init__(self) -> None:
        for name, image in (("left", self.left), ("right", self.right)):
            check_image(name, image)
        check_same_size("right", self.right.shape, "left", self.left.shape)
        if self.mask is not None:
            check_same_size("mask", self.mask.shape, "left", self.left.shape)
            if not self.mask.any():
                raise InvalidParameter("mask is 0 everywhere: no pixel is part of the scene")

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.left.shape[0], self.left.shape[1]


def as_mask(array: npt.NDArray[Any]) -> Mask:
    """Take bools or integers of shape (H, W), 0: not part of the scene (raises UnknownFormat for others)."""
    if array.ndim != 2 or array.dtype.kind not in "bui":
        raise UnknownFormat(
            f"mask is {array.dtype} of shape {array.shape}; expected bool or integers of shape (H, W)"
        )
    return array.astype(np.bool_)


def check_image(name: str, image: Image) -> None:
    """Refuse what is not an image of shape (H, W) or (H, W, 3), uint8 or uint16 (raises UnknownFormat)."""
    shape_fits = image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)
    if image.dtype not in (np.uint8, np.uint16) or not shape_fits or image.size == 0:
        raise UnknownFormat(
            f"{name} is {image.dtype} of shape {image.shape}; "
            "expected uint8 or uint16 of shape (H, W) or (H, W, 3), at least one pixel"
        )


def check_same_size(name: str, shape: tuple[int, ...], other: str, expected: tuple[int, ...]) -> None:
    """Refuse two shapes that differ in height or width (raises ShapeMismatch, naming both)."""
    if shape[:2] != expected[:2]:
        raise ShapeMismatch(
            f"{name} is {shape[1]} x {shape[0]} (width x height), {other} is {expected[1]} x {expected[0]}; "
            "they must be equal"
        )


@dataclass(frozen=True)
class DisparityMap:
    """A disparity map of the left image: float32, shape (H, W), pixels, `x_right = x_left - d`.

    Unknown pixels hold 0. Build one with `from_array`, which maps what is not finite or not positive to 0.
    """

    values: FloatMap

    @classmethod
    def from_array(cls, array: npt.NDArray[Any]) -> DisparityMap:
        """Take any real array of shape (H, W), in pixels (raises UnknownFormat for others)."""
        if array.ndim != 2 or array.size == 0 or array.dtype.kind not in "fiu":
            raise UnknownFormat(
                f"disparity is {array.dtype} of shape {array.shape}; expected numbers of shape (H, W)"
            )
        with np.errstate(over="ignore"):
            values = array.astype(np.float32)
        # Nearly every map is one that has 0 for unknown, which two quick looks tell; a NaN fails both.
        if not (values.min() >= 0 and values.max() < np.inf):
            values[~(np.isfinite(values) & (values > 0))] = 0
        return cls(values)

    @property
    def valid(self) -> Mask:
        """Which pixels are known, shape (H, W)."""
        return self.values > 0

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.values.shape[0], self.values.shape[1]


@dataclass(frozen=True)
class Calibration:
    """What turns disparity into depth, for images of the size that was sent: `Z = f B / (d + doffs)`."""

    focal_px: float
    """f, focal length of the rectified images, px."""
    baseline_mm: float
    """B, distance of the two cameras, mm."""
    cx: float
    """Column of the left image's principal point, px; the first column is 0."""
    cy: float
    """Row of the left image's principal point, px."""
    doffs: float = 0.0
    """Column of the right image's principal point minus `cx`, px."""

    def depth_mm(self, disparity: FloatMap) -> FloatMap:
        """Depth Z along the optical axis in mm, (H, W), of a map in px; 0 where d + doffs is not above 0.

        0 also where the depth is too large for float32.
        """
        shift = disparity.astype(np.float64) + self.doffs
        depth = np.divide(self.focal_px * self.baseline_mm, shift, out=np.zeros_like(shift), where=shift > 0)
        with np.errstate(over="ignore"):
            narrow = depth.astype(np.float32)
        narrow[~np.isfinite(narrow)] = 0
        return narrow

    def points_mm(self, depth_mm: FloatMap) -> FloatMap:
        """X right, Y down and Z forward of the left camera in mm, (H, W, 3), of a depth map (H, W) in mm."""
        rows, columns = (np.arange(side) for side in depth_mm.shape)
        depth = depth_mm.astype(np.float64)
        x = (columns - self.cx) * depth / self.focal_px
        y = (rows[:, None] - self.cy) * depth / self.focal_px
        return np.stack([x, y, depth], axis=-1).astype(np.float32)


@dataclass(frozen=True)
class RefinementResult:
    """A refined map with what is known about it; every map has the shape (H, W) of the input."""

    disparity: FloatMap
    """Pixels, finite and at least 0 everywhere."""
    confidence: FloatMap
    """Of `disparity`, in [0, 1]."""
    provenance: npt.NDArray[np.uint8]
    """Values of `Provenance`."""
    input_confidence: FloatMap
    """Of the upload, in [0, 1]; 0 where it was unknown."""
    depth_mm: FloatMap | None = None
    """Depth in mm, 0 where unknown or not part of the scene; None without a calibration."""
    timings: dict[str, float] = field(default_factory=dict)
    """Milliseconds per stage, with the keys of `Server-Timing`."""
    meta: Mapping[str, Any] = field(default_factory=dict)
    """Version, kernel hash, preset, backend, parameters, `calibration` if one was given, and `quality`."""

    @property
    def quality(self) -> Mapping[str, Any]:
        """Shares of valid, kept, refined, filled and unobserved pixels, residuals, levels and warnings."""
        quality: Mapping[str, Any] = self.meta["quality"]
        return quality

    @property
    def calibration(self) -> Calibration | None:
        """What `depth_mm` was computed with."""
        given = self.meta.get("calibration")
        return None if given is None else Calibration(**given)
