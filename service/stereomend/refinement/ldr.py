"""Local disparity refinement: what cannot be trusted is replaced from its surroundings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stereomend.disparity import Mask
from stereomend.refinement.backends import Backend, OcclusionRule, Plane, Usable
from stereomend.refinement.evidence import evidence_confidence
from stereomend.refinement.pyramid import Sparse
from stereomend.refinement.scene import Scene
from stereomend.refinement.stage_params import LdrParams

_JUMP = 1.0  # px; a smaller rise of the disparity hides nothing


class Local(NamedTuple):
    """What LDR made of a map, each (H, W) at working size."""

    u: Plane
    """Disparity without holes, pixels."""
    inliers: Mask
    """Trusted pixels, whose value did not change."""
    occluded: Mask | None = None
    """Outliers that were given the value on their left; None where nobody looked for them."""


def confidence_of(sparse: Sparse, scene: Scene, params: LdrParams, backend: Backend) -> Plane:
    """C_f (Eq. 1 to 4) or c (R1) of a map, (H, W), in [0, 1]; 0 where it is unknown."""
    if params.method == "evidence":
        return evidence_confidence(sparse, scene, params, backend)
    return backend.confidence(scene.left, scene.right, sparse.u, Usable(sparse.valid, scene.matte), params)


def refine_locally(
    sparse: Sparse, confidence: Plane, params: LdrParams, steps: int, backend: Backend
) -> Local:
    """Replace outliers (Eq. 5) by the median of the inliers met in eight directions within `steps` pixels.

    With no inlier at all every valid pixel stays, and only the unknown ones are filled. With method evidence,
    outliers left of a nearer surface are its occlusion and get the value on their left instead (R2).
    """
    inliers = sparse.valid & (confidence >= params.min_confidence)
    known = inliers if inliers.any() else sparse.valid
    local = fill_unknown(Sparse(sparse.u, known), params, steps, backend)
    if params.method == "smoothness":
        return local
    rule = OcclusionRule(_JUMP, params.occlusion_stretch, params.occlusion_slack)
    u, occluded = backend.fill_occlusions(local.u, local.inliers, rule)
    return Local(u, local.inliers, occluded)


def fill_unknown(sparse: Sparse, params: LdrParams, steps: int, backend: Backend) -> Local:
    """Fill what is not valid as LDR fills outliers; the rest stays."""
    known = np.ascontiguousarray(sparse.valid)
    return Local(backend.fill(sparse.u, known, steps, params.passes), known)
