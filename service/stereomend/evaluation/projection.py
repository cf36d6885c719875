"""From the projection matrices of two rectified cameras to what depth needs of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Calibration
from stereomend.errors import DamagedFile


def as_projection(values: Any, name: str) -> npt.NDArray[np.float64]:
    """Take 12 numbers in the order of rows as P, (3, 4) (raises DamagedFile for anything else)."""
    try:
        matrix = np.asarray(values, np.float64).reshape(3, 4)
    except (ValueError, TypeError) as error:
        raise DamagedFile(f"{name}: expected the 12 numbers of a projection matrix") from error
    if not (np.isfinite(matrix).all() and matrix[0, 0] > 0):
        raise DamagedFile(f"{name}: expected finite numbers and a focal length above 0")
    return matrix


def calibration_of(
    left: npt.NDArray[np.float64], right: npt.NDArray[np.float64], mm_per_unit: float = 1.0
) -> Calibration:
    """Compare two projection matrices P, (3, 4) px: `x = f X / Z + c + P[0, 3] / Z`.

    Args:
        left: of the left camera.
        right: of the right camera, with the same focal length.
        mm_per_unit: of the lengths in which they were calibrated.

    Raises:
        DamagedFile: the right camera is not to the right of the left one.
    """
    focal = float(left[0, 0])
    baseline = float(left[0, 3] - right[0, 3]) / focal * mm_per_unit
    if baseline <= 0:
        raise DamagedFile(f"the baseline is {baseline:g} mm; expected more than 0, are the cameras swapped?")
    return Calibration(
        focal, baseline, cx=float(left[0, 2]), cy=float(left[1, 2]), doffs=float(right[0, 2] - left[0, 2])
    )
