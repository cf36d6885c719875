"""What tissue looks like: colour, vessels, grain, fat lobules and the relief that breaks up highlights."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stereomend.opencv import cv2
from stereomend.phantom.spline import Single, smooth_noise

# Reflectances (linear RGB) of the main colour, of its patches and of the fibres in it.
_TISSUES = {
    "liver": ((0.30, 0.075, 0.06), (0.40, 0.13, 0.095), (0.42, 0.19, 0.15)),
    "peritoneum": ((0.62, 0.26, 0.22), (0.52, 0.16, 0.14), (0.74, 0.47, 0.40)),
    "bowel": ((0.66, 0.33, 0.25), (0.57, 0.22, 0.18), (0.76, 0.52, 0.42)),
    "muscle": ((0.46, 0.12, 0.10), (0.36, 0.08, 0.075), (0.62, 0.33, 0.28)),
}
_FAT = np.array((0.78, 0.48, 0.17), np.float32)
# What is left of the tissue's colour under a vein and under an artery.
_VEIN = np.array((0.42, 0.28, 0.38), np.float32)
_ARTERY = np.array((0.68, 0.20, 0.20), np.float32)


@dataclass(frozen=True)
class Skin:
    """The looks of a sheet, one texel per pixel of its grid, all float32."""

    albedo: Single
    """Linear RGB reflectance, (H, W, 3)."""
    bump: Single
    """Height of the small relief in pixels (as long as one pixel is wide there), (H, W)."""
    wet: Single
    """Strength of the film of liquid, about 0 to 2, (H, W)."""


def make_skin(rng: np.random.Generator, shape: tuple[int, int], size: float) -> Skin:
    """A random tissue of shape (H, W) whose features scale with `size`, the picture's width in px."""
    albedo, bump = _ground(rng, shape, size)
    albedo, bump = _with_fat(rng, albedo, bump, size)
    vein = _vessels(rng, shape, size, count=int(rng.integers(1, 4)), width=0.009)
    artery = _vessels(rng, shape, size, count=int(rng.integers(3, 8)), width=0.0042)
    albedo = _tinted(albedo, 0.85 * vein, _VEIN)
    albedo = _tinted(albedo, 0.8 * np.maximum(artery, 0.55 * _capillaries(rng, shape, size)), _ARTERY)
    bump += 0.006 * size * vein + 0.002 * size * artery
    wet = np.clip(1.0 + 0.8 * smooth_noise(rng, shape, 0.14 * size), 0, 2).astype(np.float32)
    return Skin(albedo, bump, wet)


def _ground(rng: np.random.Generator, shape: tuple[int, int], size: float) -> tuple[Single, Single]:
    """The bare tissue: patches, fibres and grain, with the relief of the grain."""
    main, patch, fibre = (np.array(c, np.float32) for c in _TISSUES[str(rng.choice(list(_TISSUES)))])
    albedo = np.broadcast_to(main, (*shape, 3)).astype(np.float32)
    albedo = _mixed(albedo, patch, _ramp(_octaves(rng, shape, 0.16 * size, 4), 0.0, 1.2))
    albedo = _mixed(albedo, fibre, 0.6 * _ramp(_fibres(rng, shape, size), 0.7, 2.2))
    coarse, fine = _octaves(rng, shape, 0.02 * size, 3), smooth_noise(rng, shape, max(0.0035 * size, 1.4))
    albedo *= np.exp(0.10 * coarse + 0.09 * fine)[..., None]
    # Smooth relief lets a highlight wander between the views, fine relief pins it.
    bump = 0.00008 * size * fine
    for height, cell in ((0.009, 0.1), (0.0022, 0.045), (0.0005, 0.016)):
        bump += height * size * smooth_noise(rng, shape, max(cell * size, 1.4))
    return albedo, bump.astype(np.float32)


def _octaves(rng: np.random.Generator, shape: tuple[int, int], cell: float, count: int) -> Single:
    """Noise with finer and weaker details, about unit variance."""
    total = np.zeros(shape, np.float32)
    for k in range(count):
        total += 0.6**k * smooth_noise(rng, shape, max(cell / 2**k, 1.4))
    return total / np.float32(np.sqrt(sum(0.36**k for k in range(count))))


def _fibres(rng: np.random.Generator, shape: tuple[int, int], size: float) -> Single:
    """Strands along a direction that wanders: stretched noise, bent by smooth noise."""
    strands = smooth_noise(rng, (2 * shape[0] + 8, shape[1] + 8), max(0.006 * size, 1.4), stretch=14)
    turn = rng.uniform(0, np.pi)
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    bend = 0.06 * size
    across = -x * np.sin(turn) + y * np.cos(turn) + bend * smooth_noise(rng, shape, 0.25 * size)
    along = x * np.cos(turn) + y * np.sin(turn) + bend * smooth_noise(rng, shape, 0.25 * size)
    return _sampled(strands, along, across)


def _sampled(image: Single, x: npt.NDArray[np.floating], y: npt.NDArray[np.floating]) -> Single:
    """The image at positions (x, y), mirrored beyond its border."""
    sampled = cv2.remap(
        image, x.astype(np.float32), y.astype(np.float32), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
    )
    return np.asarray(sampled, np.float32)


def _with_fat(rng: np.random.Generator, albedo: Single, bump: Single, size: float) -> tuple[Single, Single]:
    """Yellow fat in patches, as domes packed side by side."""
    shape = bump.shape
    amount = 0.9 * _ramp(_octaves(rng, shape, 0.2 * size, 3), rng.uniform(0.5, 1.6), 2.2)
    dome = _lobules(rng, shape, max(0.035 * size, 2.0))
    colour = _FAT * (0.62 + 0.38 * dome)[..., None]
    return _mixed(albedo, colour, amount), bump + 0.010 * size * dome * amount


def _lobules(rng: np.random.Generator, shape: tuple[int, int], cell: float) -> Single:
    """Domes around random points: 1 at a point, 0 where the nearest is far."""
    count = int(np.clip(shape[0] * shape[1] / cell**2, 1, 6000))
    rows, columns = rng.integers(0, shape[0], count), rng.integers(0, shape[1], count)
    free = np.ones(shape, np.uint8)
    free[rows, columns] = 0
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 5)
    distance = cv2.GaussianBlur(np.asarray(distance, np.float32), (0, 0), max(0.06 * cell, 0.5))
    return np.asarray(np.clip(1 - (distance / (0.75 * cell)) ** 2, 0, 1), np.float32)


def _capillaries(rng: np.random.Generator, shape: tuple[int, int], size: float) -> Single:
    """A net of hair-thin vessels: the zero lines of noise, in patches."""
    net = np.zeros(shape, np.float32)
    for cell in (0.06, 0.035):
        noise = _octaves(rng, shape, cell * size, 2)
        line = np.exp(-((noise / 0.07) ** 2))
        net = np.maximum(net, line * _ramp(smooth_noise(rng, shape, 0.12 * size), 0.2, 1.4))
    return net


def _vessels(
    rng: np.random.Generator, shape: tuple[int, int], size: float, count: int, width: float
) -> Single:
    """Branching trees that come in over the border, 1 on a vessel, 0 off it; `width` is a share of `size`."""
    canvas = np.zeros(shape, np.uint8)
    for _ in range(count):
        start, aim = rng.uniform(0, 1, 2), rng.uniform(0.2, 0.8, 2)
        start[rng.integers(2)] = rng.integers(2)
        (x, y), (across, down) = start * (shape[1], shape[0]), (aim - start) * (shape[1], shape[0])
        _grow(rng, canvas, _Branch(x, y, math.atan2(down, across), width * size))
    soft = cv2.GaussianBlur(canvas.astype(np.float32) / 255, (0, 0), max(0.0012 * size, 0.5))
    return np.asarray(soft, np.float32).reshape(shape)


@dataclass(frozen=True)
class _Branch:
    """Where a vessel goes on: position and width in px, direction in radians."""

    x: float
    y: float
    heading: float
    width: float


def _grow(rng: np.random.Generator, canvas: npt.NDArray[np.uint8], stem: _Branch) -> None:
    """Draw a tree of vessels: wandering paths that taper and fork until too thin or off the canvas."""
    waiting = [stem]
    for _ in range(80):
        if not waiting:
            return
        waiting += _draw_path(rng, canvas, waiting.pop(0))


def _draw_path(rng: np.random.Generator, canvas: npt.NDArray[np.uint8], branch: _Branch) -> list[_Branch]:
    """Draw one path and return the branches that leave it."""
    x, y, heading, width = branch.x, branch.y, branch.heading, branch.width
    height, across = canvas.shape
    bend, forks = 0.0, []
    while width > 0.9 and -9 <= x <= across + 9 and -9 <= y <= height + 9:
        step = max(0.35 * width, 0.8)
        bend = 0.95 * bend + rng.normal(0, 0.012)
        heading += bend * step / width
        x, y, width = x + step * math.cos(heading), y + step * math.sin(heading), 0.997 * width
        cv2.circle(canvas, (int(16 * x), int(16 * y)), int(8 * width), 255, -1, cv2.LINE_AA, 4)
        if rng.random() < 0.014:
            side = (1 if rng.random() < 0.5 else -1) * rng.uniform(0.4, 0.9)
            forks.append(_Branch(x, y, heading + side, width * rng.uniform(0.45, 0.8)))
            heading, width = heading - 0.3 * side, 0.95 * width
    return forks


def _ramp(values: npt.NDArray[np.floating], low: float, high: float) -> Single:
    """A smooth step from 0 at `low` to 1 at `high`."""
    t = np.clip((values - low) / (high - low), 0, 1).astype(np.float32)
    return np.asarray(t * t * (3 - 2 * t), np.float32)


def _mixed(colour: Single, other: Single, amount: Single) -> Single:
    """`colour` replaced by `other` to the share `amount`."""
    return colour + (other - colour) * amount[..., None]


def _tinted(colour: Single, amount: Single, tint: Single) -> Single:
    """`colour` times `tint` to the share `amount`."""
    return colour * (1 - amount[..., None] * (1 - tint))
