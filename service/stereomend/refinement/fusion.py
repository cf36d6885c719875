"""The choice, pixel by pixel, between the upload and what GDR found (R7 to R10 of `docs/robust.md`).

What was uploaded stays where it is as good as what refinement can reach, so that a good map is never made
worse.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stereomend.disparity import Mask
from stereomend.opencv import cv2
from stereomend.refinement.backends import Backend, Plane
from stereomend.refinement.evidence import fading, mean_around, ramp, speckles
from stereomend.refinement.params import RefineParams
from stereomend.refinement.pyramid import HALF, Sparse, enlarge_disparity, sample, sample_disparity
from stereomend.refinement.scene import Scene
from stereomend.refinement.smooth import CELL, Array, Grid, blurred, fit_planes, ratio
from stereomend.refinement.stage_params import FusionParams

_FAR = 4  # times as wide: the faint window that carries trust over gaps
_MARGIN = 3  # px from the frame, where descriptors still see only the pair
_AROUND_HIDDEN = 2  # px that a descriptor and its window see of what is hidden
_BESIDE_HIDDEN = 4  # px that a window sees of it where two readings are compared
_AROUND_GLINTS = 4  # px
_CLOSE = 3  # side of the window that two readings are compared over where they differ, px
_PATCH = 11  # side of the window that holes are looked for in, px
_ROUGH = 15  # and steps, px
_ALL_BUT_COMPLETE = (0.9, 0.97)  # trust
_CHECKABLE = (0.3, 0.7)  # evidence for GDR's map that lets a pixel vote
_TOUCHED = 1e-4  # support of a plane


class Readings(NamedTuple):
    """The two maps at working size, px."""

    upload: Sparse
    """Sampled, not averaged: a mean of two surfaces would lie on neither."""
    u: Plane


class Fused(NamedTuple):
    """The outcome at working size, each (H, W)."""

    u: Plane
    """GDR's map, continued beyond the right image's frame, px."""
    share: Plane
    """Of the upload, 0 to 1."""
    upload: Sparse
    """Its samples, px."""

    @property
    def chosen(self) -> Mask:
        """Where the upload stays, (H, W)."""
        return self.share > HALF

    @property
    def mixed(self) -> Plane:
        """Both maps put together, (H, W) px."""
        return np.where(self.chosen, self.upload.u, self.u)


@dataclass(frozen=True)
class _Judge:
    """What every step of the choice needs."""

    scene: Scene
    maps: Readings
    params: FusionParams
    scale: float
    """Working size divided by input size."""
    backend: Backend

    @property
    def grid(self) -> Grid:
        return Grid(self.scene.size, self.backend)

    def wide(self, share: float) -> float:
        """A share of the width, px."""
        return share * self.scene.size[1]


class _Seen(NamedTuple):
    """What the pair says, each (H, W)."""

    upload: Mask
    """Valid, and shown by the right image if the upload is right."""
    u: Mask
    for_upload: Plane
    """Evidence n."""
    for_u: Plane
    near: Mask
    """Both say nearly the same."""
    glints: Mask


class _Trust(NamedTuple):
    """How far the upload can be trusted, each (H, W)."""

    level: Plane
    """0 to 1 (R8)."""
    enough: Mask
    """The level is half way to full trust or more."""
    equal: Plane
    """0 to 1: where both say nearly the same, it is as good as GDR's map (R9)."""
    strong: Mask
    """GDR's map is really seen, not only not hidden."""
    wins: Mask
    """The upload has clearly more evidence."""
    comparable: Mask
    """The upload is shown, and not beside what a trusted upload hides: that spoils its evidence."""


def fuse(scene: Scene, maps: Readings, params: RefineParams, backend: Backend) -> Fused:
    """Choose between the upload and GDR's map."""
    judge = _Judge(scene, maps, params.fusion, params.processing_scale, backend)
    seen = _look(judge)
    trust = _trust(judge, seen)
    share = _share(judge, seen, trust, _reach(judge, seen, trust))
    return Fused(_continued(judge, seen), share, maps.upload)


def _look(judge: _Judge) -> _Seen:
    scene, backend, (upload, u) = judge.scene, judge.backend, judge.maps
    for_upload, for_u = backend.evidence(scene.left, scene.right, (upload.u, u))
    near = upload.valid & (np.abs(upload.u - u) < judge.params.near_px * judge.scale)
    shown = upload.valid & ~backend.unobserved(upload.u)
    return _Seen(shown, ~backend.unobserved(u), for_upload, for_u, near, _grown(~scene.matte, _AROUND_GLINTS))


def _continued(judge: _Judge, seen: _Seen) -> Plane:
    """GDR's map, bent towards the plane around it where the match lies outside of the right image (R7)."""
    u, params = judge.maps.u, judge.params
    window = max(4.0, params.reach * float(np.percentile(u[::CELL, ::CELL], 95)))
    fit = fit_planes(u, seen.u, window, judge.grid)
    limit = params.bend * np.maximum(u, 1)
    bend = np.clip(fit.value - u, -limit, limit) / (1 + fit.residual / params.flat_px**2)
    outside = (np.arange(u.shape[1]) < u) & (fit.support > _TOUCHED)
    return np.where(outside, np.maximum(u + bend, 0), u).astype(u.dtype, copy=False)


def _trust(judge: _Judge, seen: _Seen) -> _Trust:
    grid, params, (upload, u) = judge.grid, judge.params, judge.maps
    inside = np.arange(u.shape[1]) - u > _MARGIN
    votes = ramp(seen.for_u, *_CHECKABLE) * (seen.u & upload.valid & judge.scene.matte & inside)
    agreeing = votes * fading(((upload.u - u) / u.dtype.type(params.tolerance_px * judge.scale)) ** 2)
    wide = judge.wide(params.trust_width)
    agreed, voted = (_near_and_far(grid.cells(plane), wide, params) for plane in (agreeing, votes))
    level = ratio(agreed, voted)
    equal, usual = _compared(judge, seen, votes)
    trusted = np.asarray(ramp(level, params.min_trust, params.full_trust), np.float64)
    found = grid.pixels(level)
    return _Trust(
        found,
        found > (params.min_trust + params.full_trust) / 2,
        grid.pixels(equal * trusted),
        _strong(judge, seen, grid.pixels(usual)),
        _wins(judge, seen),
        _comparable(judge, seen, found),
    )


def _near_and_far(cells: Array, wide: float, params: FusionParams) -> Array:
    return blurred(cells, wide) + params.far_share * blurred(cells, _FAR * wide)


def _compared(judge: _Judge, seen: _Seen, votes: Plane) -> tuple[Array, Array]:
    """On the grid: whether the upload's evidence is as good, and how much there is for GDR's map (R9)."""
    grid, params = judge.grid, judge.params
    fair = seen.near & ~seen.glints & ~_grown(~(seen.upload & seen.u), _AROUND_HIDDEN)
    votes = votes * fair
    wide = judge.wide(params.evidence_width)

    def around(values: Plane) -> Array:
        cells = grid.cells(values)
        return blurred(cells, wide) + params.far_share * float(cells.mean())

    number, lead, level = (
        around(plane) for plane in (votes, votes * (seen.for_upload - seen.for_u), votes * seen.for_u)
    )
    equal = np.asarray(ramp(ratio(lead, level), -params.worse_by, -params.equal_within), np.float64)
    return equal, ratio(level, number)


def _reach(judge: _Judge, seen: _Seen, trust: _Trust) -> Mask:
    """What the upload says of hidden surfaces, as far as it continues what can be checked (R10)."""
    params, upload = judge.params, judge.maps.upload
    edge = judge.scene.edge
    soft = np.zeros(upload.valid.shape, np.bool_) if edge is None else edge < params.soft_edge
    contradicted = trust.strong & ~seen.near & ~trust.wins
    contradicted &= trust.comparable | (trust.level < params.high_trust)
    passing = upload.valid & trust.enough & ~contradicted & ~_rough(judge, trust, soft)
    seeds = trust.enough & seen.near & seen.u & seen.upload
    return judge.backend.reach(seeds, passing, soft, upload.u, params.step_px)


def _comparable(judge: _Judge, seen: _Seen, level: Plane) -> Mask:
    beside = _grown(judge.maps.upload.valid & ~seen.upload, _BESIDE_HIDDEN)
    return seen.upload & ~(beside & (level >= judge.params.high_trust))


def _strong(judge: _Judge, seen: _Seen, usual: Plane) -> Mask:
    """`usual`: evidence around for GDR's map where both agree, (H, W)."""
    weak = mean_around(seen.for_u, _CLOSE + 2) < judge.params.weak_share * usual
    return seen.u & ~weak & ~seen.glints


def _wins(judge: _Judge, seen: _Seen) -> Mask:
    lead = mean_around(seen.for_upload - seen.for_u, _CLOSE)
    return seen.upload & (lead > judge.params.win_margin)


def _rough(judge: _Judge, trust: _Trust, soft: Mask) -> Mask:
    """Where the upload steps up and down, or has holes: what no surface does."""
    params, (u, valid) = judge.params, judge.maps.upload
    largest = np.zeros(u.shape, u.dtype)
    largest[:, :-1] = np.abs(np.diff(u, axis=1))
    largest[:-1] = np.maximum(largest[:-1], np.abs(np.diff(u, axis=0)))
    steps = ((largest > 1.05 * params.step_px) & ~soft) | ~valid
    most = params.rough_share + (params.trusted_rough_share - params.rough_share) * ramp(
        trust.level, *_ALL_BUT_COMPLETE
    )
    rough: Mask = mean_around(steps.astype(u.dtype), _ROUGH) > most
    return rough | (mean_around((~valid).astype(u.dtype), _PATCH) > params.unknown_share)


def _share(judge: _Judge, seen: _Seen, trust: _Trust, reached: Mask) -> Plane:
    params, upload = judge.params, judge.maps.upload
    apart = np.where(trust.strong & trust.comparable, trust.enough & trust.wins, reached)
    together = np.where(seen.u, trust.equal, reached)
    kept = upload.valid & ~speckles(upload, params.patch_share, judge.backend)
    share: Plane = np.where(seen.near, together, apart) * kept
    return share.astype(upload.u.dtype, copy=False)


def _grown(mask: Mask, by: int) -> Mask:
    side = 2 * by + 1
    grown: Mask = cv2.dilate(mask.view(np.uint8), np.ones((side, side), np.uint8)).view(np.bool_)
    return grown.reshape(mask.shape)


def at_input_size(fused: Fused, upload: Sparse, near_px: float, backend: Backend) -> Plane:
    """Put both maps together at input size, (H, W) px: blended where they are near, else one of them.

    A pixel of the upload that fits none of the chosen samples around, which are fewer, was never judged.
    """
    size = (upload.u.shape[0], upload.u.shape[1])
    u, share = enlarge_disparity(fused.u, size, backend), backend.enlarge(fused.share, size)
    near = np.abs(upload.u - u) < near_px
    judged = np.where(sample(fused.chosen, size), sample_disparity(fused.upload, size).u, u)
    chosen = np.where(_fits(fused, upload.u), upload.u, judged)
    hard = np.where(upload.valid & (share > HALF), chosen, u)
    blended = share * upload.u + (1 - share) * u
    return np.where(near & upload.valid, blended, hard).astype(u.dtype, copy=False)


def _fits(fused: Fused, u: Plane) -> Mask:
    size, beyond = (u.shape[0], u.shape[1]), fused.upload.u.dtype.type(1e9)
    chosen, window = fused.chosen, np.ones((3, 3), np.uint8)
    least = cv2.erode(np.where(chosen, fused.upload.u, beyond), window)
    most = cv2.dilate(np.where(chosen, fused.upload.u, -beyond), window)
    ratio = size[1] / fused.u.shape[1]
    fits: Mask = (u >= sample(least, size) * ratio - 1) & (u <= sample(most, size) * ratio + 1)
    return fits
