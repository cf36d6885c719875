"""Random scenes: curved tissue with grooves, lobes that overlap it, perhaps an instrument."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stereomend.phantom.rays import LEFT, Layer, Rig, Scene, cast, frame_grid
from stereomend.phantom.shaft import Shaft
from stereomend.phantom.spline import Grid, Real, Surface, smooth_noise

# Where a lobe ends it stands this share of its lift above what is behind: rays pass below its rim.
_RIM = 0.5


@dataclass(frozen=True)
class Frame:
    """What a scene is made for: cameras, the grid of its surfaces, its nearest point's disparity in px."""

    rig: Rig
    grid: Grid
    max_disparity: float

    @classmethod
    def of(cls, width: int, height: int, max_disparity: float) -> Frame:
        """A frame with a focal length of 1.05 widths, as laparoscopes have, and a baseline of 4.5 mm."""
        rig = Rig(width, height, 1.05 * width, 4.5)
        return cls(rig, frame_grid(width, height, max_disparity), max_disparity)


def make_scene(rng: np.random.Generator, frame: Frame, instrument: bool) -> Scene:
    """A scene whose largest disparity in the left image is `frame.max_disparity`, to about 1 %."""
    farthest = rng.uniform(0.58, 0.7) if instrument else rng.uniform(0.42, 0.56)
    relief = _relief(rng, frame, farthest)
    layers = [Layer(Surface(frame.grid, relief))]
    layers += [_lobe(rng, frame, relief) for _ in range(rng.integers(1, 3))]
    scene = _nearest_at(Scene(frame.rig, tuple(layers)), frame.max_disparity)
    if instrument:
        scene = _nearest_at(replace(scene, shaft=_shaft(rng, frame, scene)), frame.max_disparity)
    return scene


def _nearest_at(scene: Scene, disparity: float) -> Scene:
    """The scene moved in depth until its largest visible disparity is `disparity`, px."""
    # Every move changes a little what is visible.
    for _ in range(4):
        scene = _scaled(scene, disparity / _largest(scene))
    return scene


def _largest(scene: Scene) -> float:
    """The largest disparity in the left image, from at most 64 rows and 320 columns of it."""
    y, x = (
        np.unique(np.linspace(0, n - 1, most).round())
        for n, most in ((scene.rig.height, 64), (scene.rig.width, 320))
    )
    return float(cast(scene, y, np.broadcast_to(x, (y.size, x.size)), LEFT).disparity.max())


def _scaled(scene: Scene, factor: float) -> Scene:
    """The scene with all disparities times `factor`: every point slides along its cyclopean ray."""
    layers = tuple(replace(layer, disparity=layer.disparity.scaled(factor)) for layer in scene.layers)
    shaft = scene.shaft
    if shaft is not None:
        shaft = replace(shaft, tip=shaft.tip / factor, radius=shaft.radius / factor)
    return replace(scene, layers=layers, shaft=shaft)


def _relief(rng: np.random.Generator, frame: Frame, farthest: float) -> Real:
    """Disparity of the tissue behind everything, largest 1 and smallest `farthest` within the frame."""
    size, shape = frame.rig.size, frame.grid.shape
    rough = np.zeros(shape)
    for share, cell in ((1, 0.5), (0.4, 0.22), (0.1, 0.1), (0.025, 0.05)):
        rough += share * smooth_noise(rng, shape, cell * size)
    x, y = frame.grid.axes()
    turn = rng.uniform(0, 2 * np.pi)
    relief = rough + 1.6 * (x * np.cos(turn) + y * np.sin(turn)) / size
    seen = _inside(frame, relief)
    low, high = float(seen.min()), float(seen.max())
    relief = farthest + (1 - farthest) * (relief - low) / max(high - low, 1e-9)
    for _ in range(rng.integers(1, 4)):
        relief = relief - _groove(rng, frame)
    return np.asarray(np.clip(relief, 0.6 * farthest, 1.25))


def _inside(frame: Frame, values: Real) -> Real:
    """The part of a grid's values that lies in the frame."""
    rows, columns = -frame.grid.y0, -frame.grid.x0
    seen: Real = values[rows : rows + frame.rig.height, columns : columns + frame.rig.width]
    return seen


def _curve(rng: np.random.Generator, frame: Frame, bend: float) -> Real:
    """About the signed distance in px to a random curve through the middle part of the frame."""
    x, y = frame.grid.axes()
    turn = rng.uniform(0, 2 * np.pi)
    px, py = rng.uniform(0.25, 0.75, 2) * (frame.rig.width, frame.rig.height)
    line = (x - px) * np.cos(turn) + (y - py) * np.sin(turn)
    waves = smooth_noise(rng, frame.grid.shape, 0.3 * frame.rig.size)
    waves += 0.25 * smooth_noise(rng, frame.grid.shape, 0.1 * frame.rig.size)
    return np.asarray(line + bend * frame.rig.size * waves, dtype=np.float64)


def _groove(rng: np.random.Generator, frame: Frame) -> Real:
    """A crease in the tissue: steep on one side, shallow on the other."""
    distance = _curve(rng, frame, 0.06) / frame.rig.size
    width = np.where(distance > 0, rng.uniform(0.008, 0.016), rng.uniform(0.03, 0.08))
    depth = rng.uniform(0.02, 0.05) * np.clip(
        0.6 + 0.6 * smooth_noise(rng, frame.grid.shape, 0.3 * frame.rig.size), 0, 2
    )
    return np.asarray(depth / (1 + (distance / width) ** 2))


def _lobe(rng: np.random.Generator, frame: Frame, relief: Real) -> Layer:
    """A sheet of tissue over a part of the frame, lifted off what is behind it, with a rounded rim."""
    rim = _curve(rng, frame, 0.07)
    if (_inside(frame, rim) > 0).mean() > 0.6:
        rim = -rim
    swell = 1 + 0.3 * smooth_noise(rng, frame.grid.shape, 0.25 * frame.rig.size)
    lift = rng.uniform(0.1, 0.19) * np.clip(swell, 0.5, 2)
    inwards = np.clip(rim / max(rng.uniform(0.03, 0.07) * frame.rig.size, 2), 0, 1)
    rounded = _RIM + (1 - _RIM) * np.sqrt(1 - (1 - inwards) ** 2)
    profile = np.where(rim >= 0, rounded, np.maximum(_RIM + 0.5 * rim, -1))
    return Layer(Surface(frame.grid, relief + lift * profile), Surface(frame.grid, rim))


def _shaft(rng: np.random.Generator, frame: Frame, scene: Scene) -> Shaft:
    """An instrument from outside the frame to its middle, nearer than all tissue along its way.

    A straight line in space is straight in the image too, and its disparity is linear along it.
    """
    start, end = _shaft_ends(rng, frame)
    share = np.linspace(0, 1, 25)
    line = start + share[:, None] * (end - start)
    behind = _tissue_near(frame, scene, line)
    first = rng.uniform(1.13, 1.2) * float(behind[share < 0.4].max())
    last = max(first * rng.uniform(1.0, 1.2), _least_end(first, share[1:], 1.12 * behind[1:]))
    tip, far = _in_space(frame.rig, start, first), _in_space(frame.rig, end, last)
    radius_px = rng.uniform(0.024, 0.036) * frame.rig.size
    return Shaft(tip, (far - tip) / np.linalg.norm(far - tip), radius_px * tip[2] / frame.rig.focal_px)


def _shaft_ends(rng: np.random.Generator, frame: Frame) -> tuple[Real, Real]:
    """Cyclopean positions, px, of the tip and of a point on the border: the lower one or a side."""
    size = np.array([frame.rig.width, frame.rig.height])
    tip = rng.uniform(0.35, 0.65, 2) * size
    turn = rng.uniform(-0.25, 1.25) * np.pi
    towards = np.array([np.cos(turn), np.sin(turn)])
    reach = np.min(np.where(towards > 0, size - tip, tip) / np.maximum(np.abs(towards), 1e-9))
    return tip, tip + towards * reach


def _tissue_near(frame: Frame, scene: Scene, line: Real) -> Real:
    """The largest disparity of the tissue around points (n, 2) of the cyclopean image, px."""
    disparity = np.max([layer.disparity.at_knots() for layer in scene.layers], axis=0)
    around = int(np.ceil(0.05 * frame.rig.size))
    columns, rows = (np.rint(line) - (frame.grid.x0, frame.grid.y0)).astype(int).T
    return np.array(
        [
            disparity[max(r - around, 0) : r + around + 1, max(c - around, 0) : c + around + 1].max()
            for r, c in zip(rows, columns, strict=True)
        ]
    )


def _least_end(first: float, share: Real, needed: Real) -> float:
    """The smallest end value with which a line from `first` is nowhere below `needed`."""
    return float(np.max((needed - first * (1 - share)) / share))


def _in_space(rig: Rig, position: Real, disparity: float) -> Real:
    """The point in mm at a cyclopean image position with a disparity, both px."""
    depth = rig.depth_scale / disparity
    return np.array([*(position - rig.centre) / rig.focal_px * depth, depth])
