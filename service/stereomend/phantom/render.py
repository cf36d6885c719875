"""Pictures of a scene: rays, four per pixel, then the lens and the sensor of each camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stereomend.opencv import cv2
from stereomend.phantom.rays import LEFT, RIGHT, SHAFT, Scene, cast
from stereomend.phantom.shading import Metal, light_tissue, point_of, sample, shaft_radiance, tissue_radiance
from stereomend.phantom.spline import Real, Single, smooth_noise
from stereomend.phantom.texture import make_skin

# Rows that are traced together: enough to keep NumPy busy, few enough for the cache.
_BAND = 32

_VIGNETTE = 0.45


@dataclass(frozen=True)
class Sensor:
    """How a camera turns light into grey levels: `255 * gain * sqrt(light) ** curve + bias`, then noise."""

    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    curve: float = 1.0
    bias: float = 0.0
    noise: float = 0.0
    """Standard deviation, grey levels."""
    vignette: float = 0.0
    """The share of light that the lens loses in the corners."""


@dataclass(frozen=True)
class Looks:
    """How a scene is to be seen; the defaults are two equal cameras without noise."""

    left: Sensor = Sensor()
    right: Sensor = Sensor()
    highlights: bool = True


def random_looks(rng: np.random.Generator) -> Looks:
    """Two cameras that differ as the two channels of a stereo laparoscope do."""
    gain = rng.uniform(0.9, 1.1) * rng.uniform(0.97, 1.03, 3)
    curve, bias = rng.uniform(0.94, 1.06), rng.uniform(-5, 5)
    right = Sensor((gain[0], gain[1], gain[2]), curve, bias, rng.uniform(1, 2), _VIGNETTE)
    return Looks(Sensor(noise=rng.uniform(1, 2), vignette=_VIGNETTE), right)


def render_pair(scene: Scene, looks: Looks, rng: np.random.Generator) -> list[npt.NDArray[np.uint8]]:
    """The left and the right picture, uint8 RGB (H, W, 3) each."""
    radiances = _radiances(scene, looks, rng)
    exposure = _exposure(radiances[0])
    sensors = zip(radiances, (looks.left, looks.right), strict=True)
    return [_developed(radiance * exposure, sensor, rng) for radiance, sensor in sensors]


def _radiances(scene: Scene, looks: Looks, rng: np.random.Generator) -> list[Single]:
    """Linear radiance (H, W, 3) at the pixels of the left and the right camera."""
    metal = _metal(rng, scene)
    lit = []
    for number, layer in enumerate(scene.layers):
        lit.append(light_tissue(scene, number, make_skin(rng, layer.disparity.grid.shape, scene.rig.size)))
    pictures = []
    for side in (LEFT, RIGHT):
        texels = [
            tissue_radiance(part, scene.rig, side) if looks.highlights else part.diffuse for part in lit
        ]
        pictures.append(_traced(scene, texels, metal, side))
    return pictures


def _traced(scene: Scene, texels: list[Single], metal: Metal, side: int) -> Single:
    """Radiance (H, W, 3) of one camera: the mean of 2 x 2 rays per pixel."""
    rig = scene.rig
    picture = np.empty((rig.height, rig.width, 3), np.float32)
    x = (np.arange(2 * rig.width) - 0.5) / 2
    for top in range(0, rig.height, _BAND):
        y = (np.arange(2 * top, 2 * min(top + _BAND, rig.height)) - 0.5) / 2
        rays = _band(scene, texels, metal, (y, np.broadcast_to(x, (y.size, x.size))), side)
        # A ray that meets a glint must not outshine its neighbours without bound.
        rays = np.minimum(rays, 4.0)
        picture[top : top + _BAND] = (
            rays[::2, ::2] + rays[1::2, ::2] + rays[::2, 1::2] + rays[1::2, 1::2]
        ) / 4
    return picture


def _band(scene: Scene, texels: list[Single], metal: Metal, rays: tuple[Real, Real], side: int) -> Single:
    """Radiance of the rays through the rows y (n,) and columns x (n, m), shape (n, m, 3)."""
    y, x = rays
    hits = cast(scene, y, x, side, steps=2)
    radiance = np.zeros((*x.shape, 3), np.float32)
    for number, layer in enumerate(scene.layers):
        here = hits.surface == number
        if here.any():
            radiance = np.where(
                here[..., None], sample(texels[number], layer.disparity.grid, y, hits.x), radiance
            )
    here = hits.surface == SHAFT
    if scene.shaft is not None and here.any():
        radiance[here] = shaft_radiance(scene, metal, point_of(scene.rig, y, hits)[here], scene.shaft, side)
    return radiance


def _metal(rng: np.random.Generator, scene: Scene) -> Metal:
    """The looks of an instrument: bare metal all along, or a black shaft with a metal end."""
    grey = np.float32(rng.uniform(0.2, 0.33)) * np.array((1.0, 1.0, 1.03), np.float32)
    black = np.float32(rng.uniform(0.02, 0.05)) * np.ones(3, np.float32)
    radius = scene.shaft.radius if scene.shaft is not None else 1.0
    scratches = 0.8 * smooth_noise(rng, (64, 512), 2.0, stretch=10) + 0.5 * smooth_noise(rng, (64, 512), 1.5)
    return Metal(rng.uniform(2, 7) * radius, grey, grey if rng.uniform() < 0.4 else black, scratches)


def _exposure(radiance: Single) -> float:
    """The factor that brings the bright part of a picture's tissue to 0.42."""
    return 0.42 / max(float(np.quantile(radiance.max(axis=-1), 0.85)), 1e-6)


def _developed(radiance: Single, sensor: Sensor, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """The picture a camera makes of exposed radiance (H, W, 3): glare, lens, vignette, curve, gain, noise."""
    width = radiance.shape[1]
    glare = cv2.GaussianBlur(np.clip(radiance - 0.9, 0, 2), (0, 0), max(0.008 * width, 0.5))
    light = _vignette(radiance.shape[:2], sensor.vignette)[..., None] * (
        radiance + 0.25 * glare.reshape(radiance.shape)
    )
    light = cv2.GaussianBlur(np.clip(light, 0, 1.6), (0, 0), max(0.0009 * width, 0.3)).reshape(radiance.shape)
    level = np.sqrt(np.clip(light, 0, 1)) ** np.float32(sensor.curve)
    level = 255 * level * np.array(sensor.gain, np.float32) + np.float32(sensor.bias)
    level += np.float32(sensor.noise) * rng.standard_normal(radiance.shape, dtype=np.float32)
    return np.asarray(np.clip(np.rint(level), 0, 255), np.uint8)


def _vignette(shape: tuple[int, int], loss: float) -> Single:
    """How much of the light the lens passes, (H, W): 1 in the centre, less by `loss` in the corners."""
    y, x = (np.linspace(-1, 1, n, dtype=np.float32) if n > 1 else np.zeros(1, np.float32) for n in shape)
    square = (x[None, :] ** 2 + y[:, None] ** 2) / 2
    return np.asarray(1 - loss * square**1.5, np.float32)
