"""How far a disparity map is from the truth, in the measures of the paper's Tables 2 to 4."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Calibration, DisparityMap, FloatMap, Mask, check_same_size
from stereomend.errors import NoValidDisparity

BAD_PX = (1.0, 2.0, 3.0)
"""Thresholds of the bad-n measures, px."""


@dataclass(frozen=True)
class Scores:
    """Errors over the counted pixels whose truth is known; an unknown prediction counts as disparity 0."""

    rmse: float
    """Root mean square error, px."""
    epe: float
    """End-point error: mean absolute error, px."""
    bad: Mapping[float, float]
    """Share of pixels, percent, whose error is above 1, 2 and 3 px (keys 1.0, 2.0, 3.0)."""
    pixels: int
    """How many pixels were counted."""
    missing: float
    """Share of the counted pixels, percent, without a prediction."""


def score(disparity: npt.NDArray[np.floating], truth: FloatMap, counted: Mask | None = None) -> Scores:
    """Compare a map with the truth, both (H, W) in px; not finite or not positive is unknown in either.

    Args:
        disparity: the map to judge; its unknown pixels count as disparity 0.
        truth: pixels whose truth is unknown are left out.
        counted: bool (H, W), which pixels to count; None: all whose truth is known.

    Raises:
        ShapeMismatch: the arrays differ in height or width.
        NoValidDisparity: no counted pixel has a truth.
        UnknownFormat: a map is no array of numbers of shape (H, W).
    """
    given, exact, where = _align(disparity, truth, counted)
    error = np.abs(given.values[where].astype(np.float64) - exact.values[where])
    return Scores(
        rmse=_root_mean_square(error),
        epe=float(error.mean()),
        bad={limit: 100 * float((error > limit).mean()) for limit in BAD_PX},
        pixels=error.size,
        missing=100 * float((~given.valid[where]).mean()),
    )


def depth_rmse(
    disparity: npt.NDArray[np.floating],
    truth: FloatMap,
    calibration: Calibration,
    counted: Mask | None = None,
) -> float:
    """Root mean square error of the depth `Z = f B / (d + doffs)` in mm, over the pixels that `score` counts.

    An unknown prediction counts as depth 0, so it costs the true depth of its pixel; so does a value with
    `d + doffs <= 0`. Disparity 0 itself would be infinitely far, and leaving such pixels out would reward a
    method for its holes (the SERV-CT toolkit does so, and reports the coverage beside). A pixel whose true
    depth does not exist (`d + doffs <= 0`) is left out.

    Raises:
        ShapeMismatch, NoValidDisparity, UnknownFormat: as `score` does.
    """
    given, exact, where = _align(disparity, truth, counted)
    true_mm = calibration.depth_mm(exact.values)
    given_mm = np.where(given.valid, calibration.depth_mm(given.values), 0)
    where = where & (true_mm > 0)
    _check_some(where)
    return _root_mean_square(given_mm[where].astype(np.float64) - true_mm[where])


def _align(
    disparity: npt.NDArray[np.floating], truth: FloatMap, counted: Mask | None
) -> tuple[DisparityMap, DisparityMap, Mask]:
    check_same_size("disparity", disparity.shape, "truth", truth.shape)
    given, exact = DisparityMap.from_array(disparity), DisparityMap.from_array(truth)
    where = exact.valid
    if counted is not None:
        check_same_size("counted", counted.shape, "truth", truth.shape)
        where = where & counted
    _check_some(where)
    return given, exact, where


def _check_some(where: Mask) -> None:
    if not where.any():
        raise NoValidDisparity("no counted pixel has a truth; expected at least one")


def _root_mean_square(error: npt.NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.square(error))))
