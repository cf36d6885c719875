"""Local disparity refinement: what cannot be trusted is replaced from its surroundings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stereomend.disparity import Mask
from stereomend.refinement.backends import Backend, Plane, Usable
from stereomend.refinement.params import LdrParams
from stereomend.refinement.pyramid import Sparse
from stereomend.refinement.scene import Scene


class Local(NamedTuple):
    """What LDR made of a map, each (H, W) at working size."""

    u: Plane
    """Disparity without holes, pixels."""
    inliers: Mask
    """Trusted pixels, whose value did not change."""


def confidence_of(sparse: Sparse, scene: Scene, params: LdrParams, backend: Backend) -> Plane:
    """C_f (Eq. 1 to 4) of a map, (H, W), in [0, 1]; 0 where it is unknown."""
    return backend.confidence(scene.left, scene.right, sparse.u, Usable(sparse.valid, scene.matte), params)


def refine_locally(
    sparse: Sparse, confidence: Plane, params: LdrParams, steps: int, backend: Backend
) -> Local:
    """Replace outliers (Eq. 5) by the median of the inliers met in eight directions within `steps` pixels.

    With no inlier at all every valid pixel stays, and only the unknown ones are filled.
    """
    inliers = sparse.valid & (confidence >= params.min_confidence)
    return fill_unknown(Sparse(sparse.u, inliers if inliers.any() else sparse.valid), params, steps, backend)


def fill_unknown(sparse: Sparse, params: LdrParams, steps: int, backend: Backend) -> Local:
    """Fill what is not valid as LDR fills outliers; the rest stays."""
    known = np.ascontiguousarray(sparse.valid)
    return Local(backend.fill(sparse.u, known, steps, params.passes), known)
