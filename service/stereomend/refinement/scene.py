"""The pair as the method sees it: grey levels at working size, and where the surface is no mirror."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stereomend.disparity import Image, Mask, StereoPair
from stereomend.refinement.backends import Backend, Plane, Size
from stereomend.refinement.params import LdrParams

GREY_WEIGHTS = (0.299, 0.587, 0.114)
"""BT.601 luma of R, G, B."""

BRIGHT = 215 / 255
"""HSV value above which a colourless pixel is a highlight when `specular` is "bright"."""


class Scene(NamedTuple):
    """Both images at working size, (H, W), grey levels 0 to 255."""

    left: Plane
    right: Plane
    matte: Mask
    """No specular highlight, (H, W)."""
    coloured: bool
    """The left image has any colour at all."""

    @property
    def size(self) -> Size:
        """Height and width in pixels."""
        return self.left.shape[0], self.left.shape[1]


def make_scene(pair: StereoPair, size: Size, params: LdrParams, backend: Backend) -> Scene:
    """Shrink both images to `size` and mask the highlights of the left one."""
    left = _shrunk(pair.left, size, backend)
    coloured = is_coloured(pair.left)
    mask = matte_mask(left, coloured, params)
    return Scene(grey(left), grey(_shrunk(pair.right, size, backend)), mask, coloured)


def is_coloured(image: Image) -> bool:
    """Whether any pixel differs between the channels."""
    return image.ndim == 3 and not bool((image == image[..., :1]).all())


def grey(image: Plane) -> Plane:
    """BT.601 grey levels of (H, W) or (H, W, 3)."""
    if image.ndim == 2:
        return image
    weights = np.array(GREY_WEIGHTS, image.dtype)
    return np.ascontiguousarray(image @ weights)


def matte_mask(image: Plane, coloured: bool, params: LdrParams) -> Mask:
    """M_s (Eq. 3) of an image of levels 0 to 255, (H, W) or (H, W, 3): true where no highlight is.

    An image without any colour has saturation 0 everywhere, which tells nothing: there, brightness decides.
    """
    channels = image if image.ndim == 3 else image[..., None]
    value, lowest = channels.max(axis=2), channels.min(axis=2)
    if params.specular == "off":
        return np.ones(value.shape, np.bool_)
    colourless: Mask = value - lowest <= params.min_saturation * value
    if params.specular == "bright" or not coloured:
        colourless = colourless & (value > BRIGHT * 255)
    return ~colourless


def _shrunk(image: Image, size: Size, backend: Backend) -> Plane:
    levels = backend.plane(image)
    if image.dtype == np.uint16:
        levels = levels / levels.dtype.type(257)
    return backend.shrink(levels, size)
