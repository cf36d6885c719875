"""How well the pair itself speaks for a map: agreement of descriptors, and confidence made from it.

R numbers are the equations of `docs/robust.md`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np

from stereomend.disparity import Mask
from stereomend.opencv import cv2
from stereomend.refinement.backends import Backend, Plane
from stereomend.refinement.pyramid import Sparse
from stereomend.refinement.scene import Scene
from stereomend.refinement.stage_params import GdrParams, LdrParams

WINDOW = 5
"""Side of the window that evidence is averaged over, in pixels: two of a descriptor."""

_SMALLEST = 0.5  # px; a smaller disparity is a network's way to say that it knows nothing
_SIXTEENTHS = 16  # of a pixel, in which OpenCV counts disparities


def evidence(left: Plane, right: Plane, u: Plane, backend: Backend) -> Plane:
    """n(u), (H, W) in [-1, 1]: mean inner product of left and warped right descriptors (R1)."""
    return mean_around(backend.similarity(left, right, u), WINDOW)


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
    u = sparse.u
    found = evidence(scene.left, scene.right, u, backend)
    jump = np.abs(u - _median(u))
    usable = sparse.valid & scene.matte & (u > _SMALLEST) & ~backend.unobserved(u)
    usable &= ~speckles(sparse, params.speckle_share)
    confidence: Plane = ramp(found, params.least_evidence, params.full_evidence) * fading(jump) * usable
    return confidence


def _median(u: Plane) -> Plane:
    # OpenCV has no median of float64.
    median = cv2.medianBlur(u.astype(np.float32, copy=False), WINDOW)
    return np.asarray(median, u.dtype).reshape(u.shape)


def speckles(sparse: Sparse, share: float, step: float = 1.0) -> Mask:
    """Valid pixels of smooth patches, with steps up to `step` px, below a share of the picture."""
    largest = np.iinfo(np.int16).max
    sixteenths = np.clip(np.rint(sparse.u * _SIXTEENTHS), 1, largest) * sparse.valid
    kept = sixteenths.astype(np.int16)
    cv2.filterSpeckles(kept, 0, int(share * kept.size), step * _SIXTEENTHS)
    gone: Mask = sparse.valid & (kept == 0)
    return gone


def edge_weights(channels: Sequence[Plane], params: GdrParams) -> Plane | None:
    """w, (H, W) in (0, 1], weight of the smoothness (R4), from grey or R, G, B of 0 to 255; None: 1.

    The largest channel counts: at the border of an instrument, brightness alone may hardly change.
    """
    if params.edge_falloff == 0:
        return None
    square = reduce(np.maximum, map(_square_gradient, channels))
    powers = np.asarray(cv2.pow(square / 255**2, params.edge_power / 2)).reshape(square.shape)
    weight = fading(powers * square.dtype.type(params.edge_falloff))
    return np.asarray(np.maximum(weight, params.edge_floor), square.dtype)


def _square_gradient(channel: Plane) -> Plane:
    square = np.zeros(channel.shape, channel.dtype)
    square[:, :-1] += np.diff(channel, axis=1) ** 2
    square[:-1] += np.diff(channel, axis=0) ** 2
    return square
