"""Make a phantom: a stereo pair of a random laparoscopic scene whose disparity is known exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stereomend.disparity import FloatMap, Mask, StereoPair
from stereomend.errors import InvalidParameter
from stereomend.phantom.geometry import Frame, make_scene
from stereomend.phantom.rays import LEFT, RIGHT, SHAFT, Scene, cast
from stereomend.phantom.render import random_looks, render_pair
from stereomend.phantom.spline import Real

# Rows that are traced together.
_BAND = 64

# A point is hidden when what the right camera meets first is nearer by more than this, px of disparity.
_TOLERANCE = 1e-3

_LARGEST_SIDE = 4096
_LARGEST_DISPARITY = 512.0


@dataclass(frozen=True)
class Phantom:
    """A synthetic stereo pair with all that can be known about it; every map has the shape (H, W)."""

    pair: StereoPair
    """Rectified, uint8 RGB (H, W, 3): `x_right = x_left - d`."""
    truth: FloatMap
    """Exact disparity of the left image at pixel centres, px, positive everywhere."""
    occluded: Mask
    """True where the right camera misses the point: its column x - d is negative, or something hides it."""
    instrument: Mask
    """Pixels of the left image that show the instrument."""
    focal_px: float
    """Focal length, px; the principal point is the image centre."""
    baseline_mm: float
    """Distance of the two cameras, mm: depth is `focal_px * baseline_mm / truth`."""


def make_phantom(
    seed: int,
    width: int = 640,
    height: int = 512,
    *,
    max_disparity: float | None = None,
    instrument: bool = False,
) -> Phantom:
    """Make the scene that `seed` stands for and look at it with both cameras.

    Args:
        seed: at least 0; equal arguments give equal phantoms.
        width: of both images, px, 1 to 4096.
        height: of both images, px, 1 to 4096.
        max_disparity: of the nearest point in the left image, px, up to 512; by default 6 % of the width, at
            most 120. The farthest point has about half of it.
        instrument: whether a shaft reaches into the picture, nearer than the tissue.

    Raises:
        InvalidParameter: a number is out of its range.
    """
    nearest = min(0.06 * width, 120.0) if max_disparity is None else max_disparity
    _check(seed, width, height, nearest)
    shapes, looks, pixels = np.random.default_rng([seed, width, height, int(instrument)]).spawn(3)
    scene = make_scene(shapes, Frame.of(width, height, nearest), instrument)
    left, right = render_pair(scene, random_looks(looks), pixels)
    truth, occluded, shown = observe(scene)
    return Phantom(
        StereoPair(left, right),
        truth.astype(np.float32),
        occluded,
        shown,
        scene.rig.focal_px,
        scene.rig.baseline_mm,
    )


def _check(seed: int, width: int, height: int, nearest: float) -> None:
    """Refuse numbers out of range."""
    if seed < 0:
        raise InvalidParameter(f"seed is {seed}; expected 0 or more")
    for name, side in (("width", width), ("height", height)):
        if not 1 <= side <= _LARGEST_SIDE:
            raise InvalidParameter(f"{name} is {side}; expected 1 to {_LARGEST_SIDE} pixels")
    if not (math.isfinite(nearest) and 0 < nearest <= _LARGEST_DISPARITY):
        raise InvalidParameter(
            f"max_disparity is {nearest}; expected more than 0 and at most {_LARGEST_DISPARITY:g} px"
        )


def observe(scene: Scene) -> tuple[Real, Mask, Mask]:
    """The left image's exact disparity in px, what the right camera misses, the instrument; (H, W) each."""
    bands = [_observe_band(scene, top) for top in range(0, scene.rig.height, _BAND)]
    truth, occluded, shown = (np.concatenate(parts) for parts in zip(*bands, strict=True))
    return truth, occluded, shown


def _observe_band(scene: Scene, top: int) -> tuple[Real, Mask, Mask]:
    """`observe` for the rows from `top` on."""
    y = np.arange(top, min(top + _BAND, scene.rig.height), dtype=np.float64)
    x = np.broadcast_to(np.arange(scene.rig.width, dtype=np.float64), (y.size, scene.rig.width))
    seen = cast(scene, y, x, LEFT)
    match = x - seen.disparity
    nearest = cast(scene, y, np.maximum(match, 0), RIGHT).disparity
    hidden: npt.NDArray[np.bool_] = (match < 0) | (nearest > seen.disparity + _TOLERANCE)
    return seen.disparity, hidden, seen.surface == SHAFT
