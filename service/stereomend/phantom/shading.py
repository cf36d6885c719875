"""How lit tissue and metal look from either camera: linear radiance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereomend.opencv import cv2
from stereomend.phantom.rays import Hits, Rig, Scene, camera_position, directions
from stereomend.phantom.shaft import Shaft
from stereomend.phantom.spline import Grid, Real, Single
from stereomend.phantom.texture import Skin

# The light leaves the endoscope's head between the cameras and a little above them, mm.
LIGHT = np.array([0.0, -3.5, 0.0], np.float32)

# Of the sharp part of the gleam, as an exponent.
_SHININESS = 600.0
_FILM = 4.0


@dataclass(frozen=True)
class Lit:
    """A sheet under the light, one texel per pixel of its grid (H, W): what does not depend on the camera."""

    diffuse: Single
    """Light scattered back, (H, W, 3)."""
    normal: Single
    """Unit normals with the small relief, (H, W, 3), towards the cameras."""
    point: Single
    """Positions in mm, (H, W, 3)."""
    sheen: Single
    """Light times film of liquid: what a perfect reflection would send, (H, W)."""


def light_tissue(scene: Scene, number: int, skin: Skin) -> Lit:
    """Light the sheet `number` of the scene."""
    layer = scene.layers[number]
    grid = layer.disparity.grid
    disparity = layer.disparity.at_knots().astype(np.float32)
    point = _points(scene.rig, grid, disparity)
    normal = _normals(scene.rig, grid, disparity, skin.bump)
    to_light, arriving = _arriving(scene, point)
    facing = np.einsum("...i,...i", normal, to_light)
    arriving = arriving * _shade(scene, number, point)
    # Red light wanders further in tissue, so it reaches a little around edges.
    wrap = np.array((0.22, 0.10, 0.08), np.float32)
    lambert = np.clip((facing[..., None] + wrap) / (1 + wrap), 0, None)
    diffuse = skin.albedo * (lambert * arriving[..., None] + 0.015)
    return Lit(diffuse, normal, point, skin.wet * arriving * (facing > 0))


def tissue_radiance(lit: Lit, rig: Rig, side: int) -> Single:
    """What one camera sees of a lit sheet, (H, W, 3): scattered light and the highlights of its wet film."""
    to_camera = _unit(camera_position(rig, side).astype(np.float32) - lit.point)
    half = _unit(to_camera + _unit(LIGHT - lit.point))
    shine = np.einsum("...i,...i", lit.normal, half)
    tight, broad = np.exp(_SHININESS * (shine - 1)), np.exp(_SHININESS / 40 * (shine - 1))
    return np.asarray(lit.diffuse + (lit.sheen * (_FILM * tight + 0.035 * broad))[..., None], np.float32)


def _points(rig: Rig, grid: Grid, disparity: Single) -> Single:
    """Positions in mm of a grid's pixels with the given disparity."""
    x, y = grid.axes()
    cx, cy = rig.centre
    depth = np.float32(rig.depth_scale) / np.maximum(disparity, 1e-6)
    u, v = ((x - cx) / rig.focal_px).astype(np.float32), ((y - cy) / rig.focal_px).astype(np.float32)
    return np.stack([u * depth, v * depth, depth], axis=-1)


def _normals(rig: Rig, grid: Grid, disparity: Single, bump: Single) -> Single:
    """Unit normals from the slope of log depth, per pixel, and of the small relief."""
    x, y = grid.axes()
    cx, cy = rig.centre
    log_depth = -np.log(np.maximum(disparity, 1e-6))
    fx = np.float32(rig.focal_px) * np.gradient(log_depth, axis=1) - np.gradient(bump, axis=1)
    fy = np.float32(rig.focal_px) * np.gradient(log_depth, axis=0) - np.gradient(bump, axis=0)
    u, v = ((x - cx) / rig.focal_px).astype(np.float32), ((y - cy) / rig.focal_px).astype(np.float32)
    return _unit(np.stack([fx, fy, -(1 + u * fx + v * fy)], axis=-1))


def _arriving(scene: Scene, point: Single) -> tuple[Single, Single]:
    """Unit vectors (..., 3) towards the light and how much of it arrives, 1 at the nearest tissue's depth."""
    away = LIGHT - point
    square = np.einsum("...i,...i", away, away)
    to_light = away / np.sqrt(square)[..., None]
    nearest = scene.rig.depth_scale / float(scene.layers[0].disparity.control.max())
    cone = np.clip(-to_light[..., 2], 0, 1) ** 5
    return to_light, cone * np.float32(1.25 * nearest**2) / square


def _shade(scene: Scene, number: int, point: Single) -> Single:
    """The share of light that passes what lies over a sheet: the instrument, the rims of lobes."""
    share = np.ones(point.shape[:2], np.float32)
    if number == 0:
        # Lobes may pass through one another, so only the tissue behind all of them is sure to lie below.
        for rim in (layer.rim for layer in scene.layers if layer.rim is not None):
            outside = np.clip(-rim.at_knots() / (0.018 * scene.rig.size), 0, None).astype(np.float32)
            share *= 1 - 0.6 * np.exp(-outside)
    if scene.shaft is not None:
        share *= _shadow(scene.shaft, point)
    return share


def _shadow(shaft: Shaft, point: Single) -> Single:
    """The instrument's shadow, from how near the way from the light to a point comes to its axis."""
    way = point - LIGHT
    axis, tip = shaft.axis.astype(np.float32), (shaft.tip - LIGHT).astype(np.float32)
    a, b = np.einsum("...i,...i", way, way), way @ axis
    d, e = way @ tip, float(tip @ axis)
    on_way = np.clip((d - b * e) / np.maximum(a - b * b, 1e-6), 0, 1)
    on_axis = np.maximum(on_way * b - e, 0)
    gap = on_way[..., None] * way - tip - on_axis[..., None] * axis
    away = np.sqrt(np.einsum("...i,...i", gap, gap)) / np.float32(shaft.radius)
    edge = np.clip((away - 0.8) / 0.5, 0, 1)
    return np.asarray(0.3 + 0.7 * edge * edge * (3 - 2 * edge), np.float32)


def _unit(vectors: Single | Real) -> Single:
    length = np.sqrt(np.einsum("...i,...i", vectors, vectors))
    return np.asarray(vectors / length[..., None], np.float32)


@dataclass(frozen=True)
class Metal:
    """The looks of an instrument: a bright metal end, then a shaft, with scratches along and around it."""

    end_mm: float
    """Length of the bare metal end."""
    end_colour: Single
    shaft_colour: Single
    scratches: Single
    """Unit noise over (angle, place along the axis), repeating, shape (64, 512)."""


def shaft_radiance(scene: Scene, metal: Metal, hits: Real, shaft: Shaft, side: int) -> Single:
    """What one camera sees of the instrument at points (n, 3) in mm: (n, 3)."""
    normal = shaft.normals(hits)
    to_light, arriving = _arriving(scene, hits.astype(np.float32))
    to_camera = _unit(camera_position(scene.rig, side) - hits)
    facing = np.clip(np.einsum("ni,ni->n", normal, to_light), 0, 1)
    shine = np.clip(np.einsum("ni,ni->n", normal, _unit(to_camera + to_light)), 0, 1)
    along = shaft.axial(hits)
    grain = _scratches(metal, shaft, normal, along)
    bare = (along < metal.end_mm)[:, None]
    colour = np.where(bare, metal.end_colour, metal.shaft_colour) * np.exp(0.16 * grain)[:, None]
    gloss = np.where(bare[:, 0], 0.75, 0.22) * np.exp(0.3 * grain)
    seam = 1 - 0.7 * np.exp(-(((along - metal.end_mm) / (0.12 * shaft.radius)) ** 2))
    mirrored = gloss * (0.25 * shine**10 + 0.9 * shine**70)
    radiance = (colour * facing[:, None] + mirrored[:, None]) * (arriving * seam)[:, None] + 0.01
    return np.asarray(radiance, np.float32)


def _scratches(metal: Metal, shaft: Shaft, normal: Real, along: Real) -> Real:
    """The scratches at points of the surface, between texels bilinearly."""
    side = np.cross(shaft.axis, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    angle = np.arctan2(normal @ side, normal @ np.cross(shaft.axis, side))
    rows, columns = metal.scratches.shape
    y, x = angle / (2 * np.pi) * rows, along / shaft.radius * 24
    i, j = np.floor(y).astype(int), np.floor(x).astype(int)
    v, u = y - i, x - j
    at = [metal.scratches[(i + k) % rows, (j + m) % columns] for k in (0, 1) for m in (0, 1)]
    return np.asarray((at[0] * (1 - u) + at[1] * u) * (1 - v) + (at[2] * (1 - u) + at[3] * u) * v)


def point_of(rig: Rig, y: Real, hits: Hits) -> Real:
    """Positions in mm (n, m, 3) of what rays of the rows y (n,) met."""
    depth = rig.depth_scale / hits.disparity
    point: Real = directions(rig, y, hits.x) * depth[..., None]
    return point


def sample(texels: Single, grid: Grid, y: Real, x: Real) -> Single:
    """Texels (H, W, 3) of a grid at columns x (n, m) of the rows y (n,), bicubic."""
    rows = np.broadcast_to((y - grid.y0)[:, None], x.shape).astype(np.float32)
    columns = (x - grid.x0).astype(np.float32)
    found = cv2.remap(texels, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32).reshape(*x.shape, 3)
