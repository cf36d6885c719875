"""Sizes and changes of size: from the input to the working size, and among the levels of the pyramid."""

from __future__ import annotations

from stereomend.disparity import DisparityMap, Mask
from stereomend.refinement.backends import HALF, Size, Sparse
from stereomend.refinement.backends.coarse_to_fine import enlarge_disparity, level_sizes
from stereomend.refinement.backends.sizes import sample

__all__ = ["HALF", "Sparse", "as_sparse", "enlarge_disparity", "enlarge_mask", "level_sizes", "working_size"]


def working_size(size: Size, scale: float) -> Size:
    """The size to work at: each side times `scale`, rounded, at least 1 px."""
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def enlarge_mask(mask: Mask, size: Size) -> Mask:
    """For each pixel of `size` (height, width) the flag of the pixel of `mask` that its centre falls on."""
    return sample(mask, size)


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
