"""Windows and patches of the reference: what evidence and confidence are made of (R1), in NumPy float64."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Mask

Array = npt.NDArray[np.float64]

_SIDE = 5


def mean_5x5(values: Array) -> Array:
    """Mean around each pixel, (H, W); borders are mirrored."""
    mean: Array = _windows(values, "symmetric").mean(axis=(2, 3))
    return mean


def median_5x5(values: Array) -> Array:
    """Median around each pixel, (H, W); borders are repeated."""
    median: Array = np.median(_windows(values, "edge"), axis=(2, 3))
    return median


def _windows(values: Array, mode: Any) -> Array:
    padded = np.pad(values, _SIDE // 2, mode=mode)
    return np.lib.stride_tricks.sliding_window_view(padded, (_SIDE, _SIDE))


def patches(u: Array, valid: Mask, step: float) -> npt.NDArray[np.intp]:
    """A number for each patch, (H, W): of its first pixel; what is not valid is a patch of its own.

    Every pixel takes the least number around that it is joined to, and then that pixel's, until none changes.
    """
    label = np.arange(u.size).reshape(u.shape)
    joins = [_joined(u, valid, step, axis) for axis in (0, 1)]
    while True:
        found = label.copy()
        for axis, joined in enumerate(joins):
            ahead, behind = (np.moveaxis(found, axis, 0)[part] for part in (np.s_[1:], np.s_[:-1]))
            np.minimum(ahead, behind, out=ahead, where=joined)
            np.minimum(ahead, behind, out=behind, where=joined)
        found = found.ravel()[found]
        if (found == label).all():
            return label
        label = found


def _joined(u: Array, valid: Mask, step: float, axis: int) -> Mask:
    u, valid = np.moveaxis(u, axis, 0), np.moveaxis(valid, axis, 0)
    joined: Mask = (np.abs(np.diff(u, axis=0)) <= step) & valid[1:] & valid[:-1]
    return joined
