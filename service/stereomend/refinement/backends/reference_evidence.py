"""Windows and patches of the reference: what evidence and confidence are made of (Eq. 1, R1), in float64."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Mask
from stereomend.refinement.backends.data import Plane, Size
from stereomend.refinement.stage_params import LdrParams

Array = npt.NDArray[np.float64]

_SIDE = 5


def half_of(plane: Plane) -> Size:
    """Half of a plane's sides, rounded up."""
    height, width = plane.shape
    return (height + 1) // 2, (width + 1) // 2


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


def range_around(values: Plane, chosen: Mask, by: int) -> tuple[Array, Array]:
    """Least and most of the chosen values up to `by` px away along both axes; infinite, minus it for none."""
    bounds, side = [], 2 * by + 1
    for reduced, beyond in ((np.min, np.inf), (np.max, -np.inf)):
        padded = np.pad(np.where(chosen, values, beyond), by, constant_values=beyond)
        windows = np.lib.stride_tricks.sliding_window_view(padded, (side, side))
        bounds.append(np.asarray(reduced(windows, axis=(2, 3)), np.float64))
    return bounds[0], bounds[1]


def sample(values: Plane, size: Size) -> Plane:
    """For each pixel of `size` (height, width) the value of the pixel that its centre falls on."""
    rows, columns = (
        ((np.arange(target) + 0.5) * source / target).astype(np.intp)
        for source, target in zip(values.shape, size, strict=True)
    )
    sampled: Plane = values[np.ix_(rows, columns)]
    return sampled


def patches(u: Array, valid: Mask, step: float, soft: Mask | None = None) -> npt.NDArray[np.intp]:
    """A number for each patch, (H, W): of its first pixel; what is not valid is a patch of its own.

    Valid neighbours are joined where u changes by at most `step`, or either is soft.
    Every pixel takes the least number around that it is joined to, and then that pixel's, until none changes.
    """
    label = np.arange(u.size).reshape(u.shape)
    soft = np.zeros(u.shape, np.bool_) if soft is None else soft
    joins = [_joined(u, valid, soft, step, axis) for axis in (0, 1)]
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


def patch_sizes(label: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """Of each pixel's patch, (H, W) [px]; what the frame cuts off counts as if mirrored there."""
    sizes = np.bincount(label.ravel())
    for side in (label[0], label[-1], label[:, 0], label[:, -1]):
        sizes[np.unique(side)] *= 2
    found: npt.NDArray[np.intp] = sizes[label]
    return found


def _joined(u: Array, valid: Mask, soft: Mask, step: float, axis: int) -> Mask:
    u, valid, soft = np.moveaxis(u, axis, 0), np.moveaxis(valid, axis, 0), np.moveaxis(soft, axis, 0)
    joined: Mask = (np.abs(np.diff(u, axis=0)) <= step) | soft[1:] | soft[:-1]
    return joined & valid[1:] & valid[:-1]


def window_sum(values: Array, radius: int) -> Array:
    """Sums over the square window around each pixel, as far as it lies inside, (H, W)."""
    for axis in (0, 1):
        total = np.concatenate([np.zeros_like(values.take([0], axis)), np.cumsum(values, axis)], axis)
        at = np.arange(values.shape[axis])
        last = np.minimum(at + radius + 1, values.shape[axis])
        values = total.take(last, axis) - total.take(np.maximum(at - radius, 0), axis)
    return values


def smoothness(u: Array, valid: Mask, params: LdrParams) -> Array:
    """C_s (Eq. 1), in [0, 1]; 0 where the mean over the window is not positive."""
    radius = params.window // 2
    total = window_sum(np.where(valid, u, 0.0), radius)
    count = window_sum(valid.astype(np.float64), radius)
    mean = np.divide(total, count, out=np.zeros_like(u), where=(count > 0) & (total > 0))
    deviation = np.divide(np.abs(u - mean), mean, out=np.full_like(u, np.inf), where=mean > 0)
    with np.errstate(invalid="ignore"):
        return np.where(mean > 0, np.maximum(0, 1 - params.smoothness_weight * deviation), 0.0)


def unobserved(u: Array) -> Mask:
    """See `Backend.unobserved`."""
    width = u.shape[1]
    column = np.arange(width) - u
    leftmost = np.minimum.accumulate(column[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(u.shape, np.bool_)
    hidden[:, :-1] = leftmost[:, 1:] <= column[:, :-1] - 1
    unseen: Mask = hidden | (column < 0) | (column > width - 1)
    return unseen


def shown(u: Array, valid: Mask) -> tuple[Mask, Mask]:
    """See `Backend.shown`."""
    unseen = unobserved(u)
    hidden: Mask = valid & unseen
    hidden[:, 2:-2] |= (u[:, 4:] - u[:, :-4] >= 2) & valid[:, :-4]
    return valid & ~unseen, hidden
