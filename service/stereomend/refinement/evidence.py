"""How well the pair itself speaks for a map: agreement of descriptors, and confidence made from it.

R numbers are the equations of `docs/robust.md`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stereomend.disparity import Mask
from stereomend.opencv import cv2
from stereomend.refinement.backends import Backend, Plane, SpeckleRule, Usable
from stereomend.refinement.pyramid import Sparse
from stereomend.refinement.scene import Scene
from stereomend.refinement.stage_params import GdrParams, LdrParams


def mean_around(values: Plane, side: int) -> Plane:
    """Mean over the square window of `side` pixels around each pixel, (H, W); borders are mirrored."""
    # OpenCV mirrors no further than the image reaches.
    mean = cv2.blur(values, (side, side), borderType=cv2.BORDER_REFLECT)
    return np.asarray(mean, values.dtype).reshape(values.shape)


def ramp(values: Plane, low: float, high: float) -> Plane:
    """0 up to `low`, 1 from `high` on, linear between them."""
    share = np.clip((values - low) / max(high - low, 1e-9), 0, 1)
    return np.asarray(share, values.dtype)


def fading(values: Plane) -> Plane:
    """exp(-values)."""
    # OpenCV's exponential takes a quarter of NumPy's time.
    return np.asarray(cv2.exp(-values), values.dtype).reshape(values.shape)


def evidence_confidence(sparse: Sparse, scene: Scene, params: LdrParams, backend: Backend) -> Plane:
    """c, (H, W) in [0, 1] (R1): evidence, smoothness, and none where hidden, glinting or a speckle."""
    usable = Usable(sparse.valid, scene.matte)
    return backend.evidence_confidence(scene.left, scene.right, sparse.u, usable, params)


def speckles(sparse: Sparse, share: float, backend: Backend) -> Mask:
    """Valid pixels of smooth patches, with steps up to 1 px, of up to a share of the picture."""
    return backend.speckles(sparse.u, sparse.valid, SpeckleRule.of(share, sparse.u))


def edge_weights(channels: Sequence[Plane], params: GdrParams, backend: Backend) -> Plane | None:
    """w, (H, W) over 0 to 1, weight of the smoothness (R4), from grey or R, G, B of 0 to 255; None: 1.

    The largest channel counts: at the border of an instrument, brightness alone may hardly change.
    """
    return None if params.edge_falloff == 0 else backend.edge_weights(channels, params)
