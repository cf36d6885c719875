"""The pair as the method sees it: grey levels at working size, and where the surface is no mirror."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Image, Mask, StereoPair
from stereomend.opencv import cv2
from stereomend.refinement.backends import HALF, Backend, GlintRule, Plane, Size
from stereomend.refinement.stage_params import LdrParams

_ROWS = 64

BRIGHT = 215 / 255
"""HSV value above which a colourless pixel is a highlight when `specular` is "bright"."""

_GLINT_SHARE = 0.06  # of the width; larger bright areas are things
_GLINT = GlintRule(saturation=60 / 255, bright=BRIGHT * 255, rise=40.0)


class Scene(NamedTuple):
    """Both images at working size, (H, W), grey levels 0 to 255."""

    left: Plane
    right: Plane
    matte: Mask
    """No specular highlight, (H, W)."""
    coloured: bool
    """The left image has any colour at all."""
    channels: tuple[Plane, ...]
    """Of the left image: grey, or R, G and B, each (H, W), levels 0 to 255."""
    edge: Plane | None = None
    """Weight of the smoothness, (H, W), over 0 to 1; None: 1 everywhere."""
    weight: Plane | None = None
    """The share of each pixel that is part of the scene, (H, W), 0 to 1; None: all of each."""

    def shown(self, pixels: Mask) -> Mask:
        """Those of `pixels` (H, W) of which half or more is part of the scene."""
        return pixels if self.weight is None else pixels & (self.weight >= HALF)

    @property
    def size(self) -> Size:
        """Height and width in pixels."""
        return self.left.shape[0], self.left.shape[1]


def make_scene(pair: StereoPair, size: Size, params: LdrParams, backend: Backend) -> Scene:
    """Shrink both images and the mask to `size` and find the highlights of the left one."""
    channels, left = backend.shades(pair.left, size)
    right = backend.grey(pair.right, size)
    coloured = is_coloured(pair.left)
    matte = matte_mask(channels, coloured, params, backend)
    weight = None if pair.mask is None else backend.shrink(pair.mask, size)
    return Scene(left, right, matte, coloured, tuple(channels), weight=weight)


def is_coloured(image: Image) -> bool:
    """Whether any pixel differs between the channels."""
    if image.ndim == 2:
        return False
    return any(map(_rows_coloured, in_bands(image)))


def in_bands(plane: npt.NDArray[Any]) -> Iterator[npt.NDArray[Any]]:
    """Some rows after the other, from the top: for questions that the first ones mostly answer."""
    return (plane[top : top + _ROWS] for top in range(0, plane.shape[0], _ROWS))


def _rows_coloured(rows: Image) -> bool:
    first = rows[..., 0]
    return bool((rows[..., 1] != first).any() or (rows[..., 2] != first).any())


def matte_mask(channels: Sequence[Plane], coloured: bool, params: LdrParams, backend: Backend) -> Mask:
    """M_s (Eq. 3) of grey or of R, G, B, levels 0 to 255, each (H, W): true where no highlight is.

    An image without any colour has saturation 0 everywhere, which tells nothing: there, brightness decides.
    """
    if params.specular == "off":
        return np.ones(channels[0].shape, np.bool_)
    if params.specular == "glint":
        return ~_glints(channels, backend)
    value, lowest = reduce(np.maximum, channels), reduce(np.minimum, channels)
    colourless: Mask = value - lowest <= params.min_saturation * value
    if params.specular == "bright" or not coloured:
        colourless = colourless & (value > BRIGHT * 255)
    return ~colourless


def _glints(channels: Sequence[Plane], backend: Backend) -> Mask:
    """Bright, colourless and small: a mirror image of the lamp, and not a white organ (R1)."""
    glints, nearly = backend.glints(channels, _GLINT)
    side = max(3, round(_GLINT_SHARE * glints.shape[1])) | 1  # odd, or the opening shifts by a pixel
    for inner, outer in _as_bright_around(nearly, side):
        value = reduce(np.maximum, [channel[outer] for channel in channels])
        surroundings = cv2.morphologyEx(np.ascontiguousarray(value), cv2.MORPH_OPEN, _square(side))
        rise = value - surroundings.reshape(value.shape)
        glints[inner] &= rise[tuple(map(_within, inner, outer))] > _GLINT.rise
    return glints


_Part = tuple[slice, ...]


def _as_bright_around(nearly: Mask, side: int) -> list[tuple[_Part, _Part]]:
    """Where an opening can hide a glint, if anywhere, and what it has to look at for that.

    Only where a whole window is nearly as bright as a glint: bytes tell that at a fraction of its cost.
    """
    x, y, width, height = cv2.boundingRect(
        cv2.erode(nearly.view(np.uint8), _square(side)).reshape(nearly.shape)
    )
    if not width:
        return []
    inner, outer = (
        (slice(max(0, y - by), y + height + by), slice(max(0, x - by), x + width + by))
        for by in (side // 2, 2 * side)
    )
    return [(inner, outer)]


def _within(inner: slice, outer: slice) -> slice:
    return slice(inner.start - outer.start, inner.stop - outer.start)


def _square(side: int) -> npt.NDArray[np.uint8]:
    return np.ones((side, side), np.uint8)
