"""Which point of a scene a camera ray meets first.

All surfaces are graphs over the *cyclopean* image, seen from the middle of the baseline: a surface point at
(x, y) with disparity D appears at x + D/2 in the left and at x - D/2 in the right image, in the same row.
Along a ray of the left camera the nearest point has the largest D, hence the smallest cyclopean x: the first
x where x + D(x)/2 reaches the ray's column. The right camera is the left one of the mirrored scene.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stereomend.phantom.shaft import Shaft
from stereomend.phantom.spline import Cubics, Grid, Real, Surface

LEFT, RIGHT = 1, -1
"""Sides of a camera: the sign of its half disparity."""

SHAFT = -1
"""The number of the instrument among a scene's surfaces."""


@dataclass(frozen=True)
class Rig:
    """Two ideal rectified pinhole cameras; lengths in mm, the rest in px, principal point at the centre."""

    width: int
    height: int
    focal_px: float
    baseline_mm: float

    @property
    def centre(self) -> tuple[float, float]:
        """The principal point (x, y); pixel centres lie at integers."""
        return (self.width - 1) / 2, (self.height - 1) / 2

    @property
    def size(self) -> float:
        """The length that features of the scene scale with, px: the width of a 5:4 picture."""
        return float(max(np.hypot(self.width, self.height) / 1.28, 1.0))

    @property
    def depth_scale(self) -> float:
        """f * B in px * mm: depth is this divided by disparity."""
        return self.focal_px * self.baseline_mm


@dataclass(frozen=True)
class Layer:
    """A sheet of tissue: its disparity over the cyclopean image, px, and where it ends.

    With a `rim` the sheet exists where that is at least 0 (px from its edge); beyond, `disparity` dives below
    the layers behind and what a ray meets there is not counted.
    """

    disparity: Surface
    rim: Surface | None = None


@dataclass(frozen=True)
class Scene:
    """Sheets of tissue, the first of them everywhere, and perhaps an instrument, before a pair of cameras."""

    rig: Rig
    layers: tuple[Layer, ...]
    shaft: Shaft | None = None


@dataclass(frozen=True)
class Hits:
    """What rays meet first, each array (n, m): the surface's number, cyclopean x and disparity, px."""

    surface: npt.NDArray[np.int8]
    x: Real
    disparity: Real


def cast(scene: Scene, y: Real, x: Real, side: int, steps: int = 7) -> Hits:
    """Follow one camera's rays through columns x (n, m) of the rows y (n,), px, to their first points.

    The default `steps` are exact to about 1e-9 px; 2 are enough for pictures.
    """
    best = np.full(x.shape, -np.inf)
    surface = np.zeros(x.shape, np.int8)
    for number, layer in enumerate(scene.layers):
        met = first_crossing(layer.disparity, y, x, side, steps)
        disparity = _unless_past(layer, y, met, side * 2 * (x - met))
        nearer = disparity > best
        best = np.where(nearer, disparity, best)
        surface[nearer] = number
    if scene.shaft is not None:
        disparity = _shaft_disparity(scene.rig, scene.shaft, y, x, side)
        nearer = disparity > best
        best = np.where(nearer, disparity, best)
        surface[nearer] = SHAFT
    return Hits(surface, x - side * best / 2, best)


def directions(rig: Rig, y: Real, x: Real) -> Real:
    """Ray directions with unit z for columns x (n, m) of the rows y (n,), shape (n, m, 3)."""
    cx, cy = rig.centre
    vertical = np.broadcast_to(((y - cy) / rig.focal_px)[:, None], x.shape)
    return np.stack([(x - cx) / rig.focal_px, vertical, np.ones_like(x)], axis=-1)


def camera_position(rig: Rig, side: int) -> Real:
    """The camera's centre in mm, the origin being the middle of the baseline."""
    return np.array([-side * rig.baseline_mm / 2, 0.0, 0.0])


def _shaft_disparity(rig: Rig, shaft: Shaft, y: Real, x: Real, side: int) -> Real:
    """Disparity of the instrument where a ray meets it, -inf elsewhere."""
    depth = shaft.depth_along(camera_position(rig, side), directions(rig, y, x))
    return np.where(np.isfinite(depth), rig.depth_scale / depth, -np.inf)


def _unless_past(layer: Layer, y: Real, met: Real, disparity: Real) -> Real:
    """The disparity where a ray meets the sheet, -inf where it passes the sheet's rim by."""
    if layer.rim is None:
        return disparity
    return np.where(layer.rim.at(met, y) >= 0, disparity, -np.inf)


def first_crossing(surface: Surface, y: Real, x: Real, side: int, steps: int = 7) -> Real:
    """The cyclopean x (n, m) of the nearest point on the rays through columns x of the rows y."""
    control = surface.along_rows(y)
    if side == LEFT:
        return _first_from_left(control, surface.grid.x0, x, steps)
    last = surface.grid.x0 + surface.grid.width - 1
    return -_first_from_left(control[:, ::-1], -last, -x, steps)


def _first_from_left(control: Real, x0: int, x: Real, steps: int) -> Real:
    """The first t with t + D(t)/2 = x in each row: bracketed between half-pixel nodes, then solved."""
    cubics = Cubics.of(control)
    nodes = _reach(cubics, x0)
    found = _row_search(np.maximum.accumulate(nodes, axis=1), x)
    start = np.clip(found - 1, 0, nodes.shape[1] - 1)
    cell = start // 2 + 1
    low = np.where(start % 2 == 1, 0.5, 0.0)
    t = _solve(cubics.gather(cubics.flat(cell)), x - x0 - cell, low, steps)
    return x0 + cell + t


def _reach(cubics: Cubics, x0: int) -> Real:
    """The column t + D(t)/2 of the left image at the start and the middle of each cell, (rows, 2 cells)."""
    rows, cells = cubics.a0.shape
    knots = x0 + 1 + np.arange(cells)
    reach = np.empty((rows, cells, 2))
    reach[..., 0] = knots + cubics.a0 / 2
    reach[..., 1] = knots + 0.5 + (cubics.a0 + cubics.a1 / 2 + cubics.a2 / 4 + cubics.a3 / 8) / 2
    return reach.reshape(rows, 2 * cells)


def _row_search(ascending: Real, x: Real) -> npt.NDArray[np.intp]:
    """`np.searchsorted` in every row at once: rows are laid end to end, each lifted above the one before."""
    low = min(ascending.min(), x.min())
    lift = (max(ascending.max(), x.max()) - low + 1) * np.arange(len(x))[:, None]
    found = np.searchsorted((ascending + lift).ravel(), (x + lift).ravel()).reshape(x.shape)
    return np.asarray(found - ascending.shape[1] * np.arange(len(x))[:, None])


def _solve(cubic: tuple[Real, Real, Real, Real], target: Real, low: Real, steps: int) -> Real:
    """The t in [low, low + 0.5] with t + D(t)/2 = target: Newton's method, kept in its bracket."""
    a0, a1, a2, a3 = cubic
    high = low + 0.5
    t = low + 0.25
    for _ in range(steps):
        error = t + (a0 + t * (a1 + t * (a2 + t * a3))) / 2 - target
        slope = 1 + (a1 + t * (2 * a2 + 3 * t * a3)) / 2
        low = np.where(error < 0, t, low)
        high = np.where(error < 0, high, t)
        step = t - error / np.where(slope > 1e-6, slope, 1e-6)
        t = np.where((step >= low) & (step <= high), step, (low + high) / 2)
    return t


def frame_grid(width: int, height: int, max_disparity: float) -> Grid:
    """Control points for all that either camera can see of an image of this size, with a margin."""
    margin = int(np.ceil(0.75 * max_disparity)) + 6
    return Grid(-margin, -6, width + 2 * margin, height + 12)
