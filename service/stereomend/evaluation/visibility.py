"""Which pixels both cameras see, from the disparity of both."""

from __future__ import annotations

import numpy as np

from stereomend.disparity import FloatMap, Mask

TOLERANCE_PX = 1.0
"""Both maps are sampled at whole pixels, so on slanted surfaces they differ by a part of a pixel."""


def visible_in_right(left: FloatMap, right: FloatMap, tolerance: float = TOLERANCE_PX) -> Mask:
    """Compare the disparity of each pixel with that of its match in the right image.

    Args:
        left: of the left image, (H, W) px, positive; 0 is unknown.
        right: of the right image, likewise positive: `x_left = x_right + d`.
        tolerance: the most by which they may differ, px.

    Returns:
        bool (H, W) of the left image; false where it is unknown, its match falls outside or belongs to
        another surface.
    """
    match = np.rint(np.arange(left.shape[1]) - left).astype(np.int64)
    seen = np.take_along_axis(right, np.clip(match, 0, left.shape[1] - 1), axis=1)
    agree = np.abs(seen - left) <= tolerance
    result: Mask = (left > 0) & (match >= 0) & (seen > 0) & agree
    return result
