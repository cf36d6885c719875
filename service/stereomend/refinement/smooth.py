"""Averages over wide windows, on a coarse grid: they change too slowly to be computed for every pixel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Mask
from stereomend.opencv import cv2
from stereomend.refinement.backends import Backend, Plane, Size

CELL = 8
"""Pixels per cell of the grid, along both axes."""

_RIDGE = 0.02  # of the squared window: along a line, the slope across it stays near 0
_NOTHING = 1e-6  # a weight below which there is nothing to average

Array = npt.NDArray[np.float64]


class Grid(NamedTuple):
    """Cells over a picture of `size`."""

    size: Size
    backend: Backend

    def cells(self, values: Plane) -> Array:
        """Means over cells; those that reach beyond the picture repeat its border."""
        below, right = (-side % CELL for side in self.size)
        padded = cv2.copyMakeBorder(values, 0, below, 0, right, cv2.BORDER_REPLICATE)
        height, width = (-(-side // CELL) for side in self.size)
        cells = cv2.resize(padded, (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(cells, np.float64).reshape(height, width)

    def pixels(self, cells: Array) -> Plane:
        """Back to (H, W), bilinearly."""
        height, width = self.size
        whole = (cells.shape[0] * CELL, cells.shape[1] * CELL)
        padded = self.backend.enlarge(self.backend.plane(cells), whole)
        return np.ascontiguousarray(padded[:height, :width])


def blurred(cells: Array, width_px: float) -> Array:
    """Gaussian mean with a standard deviation of `width_px` pixels; borders are mirrored."""
    sigma = max(width_px / CELL, 0.3)
    mean = cv2.GaussianBlur(cells, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
    return np.asarray(mean, np.float64).reshape(cells.shape)


def ratio(part: Array, whole: Array) -> Array:
    """Part of the whole, 0 where the whole is next to nothing."""
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > _NOTHING)


class PlaneFit(NamedTuple):
    """The plane that fits best around each pixel, each (H, W)."""

    value: Plane
    """Of the plane at the pixel."""
    residual: Plane
    """Weighted mean square of what the plane leaves."""
    support: Plane
    """Weight of what it was fitted to, 0 to 1."""


def fit_planes(u: Plane, known: Mask, width_px: float, grid: Grid) -> PlaneFit:
    """Fit a plane to the known pixels around each pixel, under a Gaussian window of `width_px` (R7)."""
    weight = known.astype(u.dtype)
    total = blurred(share := grid.cells(weight), width_px)
    y, x = ((np.indices(share.shape) + 0.5) * CELL - 0.5) / width_px

    def mean(cells: Array) -> Array:
        return ratio(blurred(cells, width_px), total)

    of_u = grid.cells(weight * u)
    at_x, at_y, at_u = mean(share * x), mean(share * y), mean(of_u)
    xx, yy = mean(share * x * x) - at_x**2 + _RIDGE, mean(share * y * y) - at_y**2 + _RIDGE
    xy, xu, yu = mean(share * x * y) - at_x * at_y, mean(of_u * x) - at_x * at_u, mean(of_u * y) - at_y * at_u
    determinant = np.maximum(xx * yy - xy**2, _RIDGE**2)
    along_x, along_y = (xu * yy - yu * xy) / determinant, (yu * xx - xu * xy) / determinant
    residual = np.maximum(mean(grid.cells(weight * u * u)) - at_u**2 - along_x * xu - along_y * yu, 0)
    value = at_u + along_x * (x - at_x) + along_y * (y - at_y)
    return PlaneFit(grid.pixels(value), grid.pixels(residual), grid.pixels(total))
