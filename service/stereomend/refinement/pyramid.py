"""Sizes and changes of size: from the input to the working size, and among the levels of the pyramid."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from stereomend.disparity import DisparityMap, Mask
from stereomend.refinement.backends import HALF, Backend, Plane, Size
from stereomend.refinement.backends.coarse_to_fine import enlarge_disparity, level_sizes

__all__ = [
    "HALF",
    "Sparse",
    "as_sparse",
    "enlarge_disparity",
    "enlarge_mask",
    "level_sizes",
    "sample",
    "sample_disparity",
    "shrink_disparity",
    "working_size",
]

S = TypeVar("S", bound=np.generic)


class Sparse(NamedTuple):
    """A disparity map (H, W) in pixels of its own size, 0 where `valid` (H, W) is false."""

    u: Plane
    valid: Mask


def working_size(size: Size, scale: float) -> Size:
    """The size to work at: each side times `scale`, rounded, at least 1 px."""
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def shrink_disparity(sparse: Sparse, size: Size, backend: Backend) -> Sparse:
    """Shrink by the area mean over valid pixels, times the width ratio; valid where half of the area is."""
    share = backend.shrink(sparse.valid, size)
    total = backend.shrink(sparse.u, size)
    valid = np.ascontiguousarray(share >= HALF)
    ratio = total.dtype.type(size[1] / sparse.u.shape[1])
    return Sparse(total / np.where(valid, share, 1) * (ratio * valid), valid)


def enlarge_mask(mask: Mask, size: Size) -> Mask:
    """For each pixel of `size` (height, width) the flag of the pixel of `mask` that its centre falls on."""
    return sample(mask, size)


def sample(values: npt.NDArray[S], size: Size) -> npt.NDArray[S]:
    """For each pixel of `size` (height, width) the value of the pixel that its centre falls on."""
    rows, columns = (
        ((np.arange(target) + 0.5) * source / target).astype(np.intp)
        for source, target in zip(values.shape, size, strict=True)
    )
    # Whole rows first, and no test of each place: half of the time.
    sampled: npt.NDArray[S] = values.take(rows, axis=0).take(columns, axis=1, mode="clip")
    return sampled


def sample_disparity(sparse: Sparse, size: Size) -> Sparse:
    """A map at another size without averaging, times the width ratio."""
    ratio = sparse.u.dtype.type(size[1] / sparse.u.shape[1])
    return Sparse(sample(sparse.u, size) * ratio, sample(sparse.valid, size))


def as_sparse(disparity: DisparityMap, mask: Mask | None = None) -> Sparse:
    """An uploaded map without what is not part of the scene (`mask` false).

    What reaches beyond the image width cannot be a match and counts as unknown.
    """
    # As nearly every map is: two quick looks, and nothing to change.
    if mask is None and disparity.values.min() >= 0 and disparity.values.max() < disparity.shape[1]:
        return Sparse(disparity.values, disparity.valid)
    valid = disparity.valid & (disparity.values < disparity.shape[1])
    valid = valid if mask is None else valid & mask
    return Sparse(disparity.values * valid, valid)
