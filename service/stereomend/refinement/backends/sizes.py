"""Changes of size in NumPy, and where the values of a map at input size come from."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Mask, Provenance
from stereomend.refinement.backends.data import HALF, Origins, Plane, Size, Sparse

Array = npt.NDArray[np.float64]
S = TypeVar("S", bound=np.generic)


def area_weights(source: int, target: int) -> Array:
    """Shares of `source` pixels in each of `target` larger ones, (target, source); rows sum to 1."""
    edges = np.arange(target + 1) * (source / target)
    upper = np.minimum(edges[1:, None], np.arange(1, source + 1))
    lower = np.maximum(edges[:-1, None], np.arange(source))
    weights: Array = np.maximum(0, upper - lower) * (target / source)
    return weights


def linear_weights(source: int, target: int) -> Array:
    """Weights of linear interpolation between pixel centres, borders repeated, (target, source)."""
    position = np.clip((np.arange(target) + 0.5) * (source / target) - 0.5, 0, source - 1)
    weights: Array = np.maximum(0, 1 - np.abs(position[:, None] - np.arange(source)))
    return weights


def resized(weights: Callable[[int, int], Array], image: Plane, size: Size) -> Array:
    """An image (H, W, ...) at another size, by weights along each axis."""
    rows, columns = (weights(*sides) for sides in zip(image.shape[:2], size, strict=True))
    result: Array = np.einsum("ij,jk...->ik...", rows, np.einsum("ij,kj...->ki...", columns, image))
    return result


def sample(values: npt.NDArray[S], size: Size) -> npt.NDArray[S]:
    """For each pixel of `size` (height, width) the value of the pixel that its centre falls on."""
    rows, columns = (
        ((np.arange(target) + 0.5) * source / target).astype(np.intp)
        for source, target in zip(values.shape, size, strict=True)
    )
    sampled: npt.NDArray[S] = values.take(rows, axis=0).take(columns, axis=1)
    return sampled


def sample_sparse(sparse: Sparse, size: Size) -> Sparse:
    """See `Backend.sample_sparse`."""
    return Sparse(sample(sparse.u, size) * (size[1] / sparse.u.shape[1]), sample(sparse.valid, size))


def shrink_sparse(sparse: Sparse, size: Size, shrink: Callable[[Plane | Mask, Size], Plane]) -> Sparse:
    """See `Backend.shrink_sparse`; `shrink` is the area mean over all pixels."""
    share = shrink(sparse.valid, size)
    valid = share >= HALF
    mean = shrink(sparse.u, size) / np.where(valid, share, 1)
    return Sparse(mean * valid * (size[1] / sparse.u.shape[1]), valid)


def tell(u: Plane, unobserved: Mask, origins: Origins) -> tuple[npt.NDArray[np.uint8], list[int]]:
    """See `Backend.tell`; `unobserved` (H, W): what the right image does not show."""
    initial, kept, scene, within = origins
    outside = unobserved if scene is None else unobserved | ~scene
    replaced = ~(initial.valid & sample(kept, u.shape))
    kind = (np.abs(u - initial.u) > within) * np.uint8(Provenance.REFINED)
    kind[replaced] = Provenance.FILLED
    kind[outside] = Provenance.UNOBSERVED
    return kind, np.bincount(kind.ravel(), minlength=len(Provenance)).tolist()
