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
from stereomend.refinement.backends import (
    CELL,
    HALF,
    Backend,
    Cells,
    ChoiceRule,
    Grounds,
    Offer,
    Plane,
    PollRule,
    Polls,
    Rivals,
)
from stereomend.refinement.params import RefineParams
from stereomend.refinement.pyramid import Sparse
from stereomend.refinement.scene import Scene
from stereomend.refinement.smooth import Sums, blurred, fit_planes, pixels, ramp, ratio
from stereomend.refinement.stage_params import FusionParams

_FAR = 4  # times as wide: the faint window that carries trust over gaps
_AROUND_HIDDEN = 2  # px that a descriptor and its window see of what is hidden
_BESIDE_HIDDEN = 4  # px that a window sees of it where two readings are compared
_AROUND_GLINTS = 4  # px
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
    params: FusionParams
    scale: float
    """Working size divided by input size."""
    backend: Backend

    def wide(self, share: float) -> float:
        """A share of the width, px; a window of few pixels tells nothing."""
        return max(share * self.scene.size[1], self.params.least_width_px)


def fuse(scene: Scene, maps: Readings, params: RefineParams, backend: Backend) -> Fused:
    """Choose between the upload and GDR's map."""
    judge = _Judge(scene, params.fusion, params.processing_scale, backend)
    rivals = _rivals(judge, maps)
    glints = _grown(~scene.matte, _AROUND_GLINTS)
    spoilt = glints | _grown(~(rivals.upload_shown & rivals.u_shown), _AROUND_HIDDEN)
    rule = PollRule(params.fusion.tolerance_px * judge.scale, params.fusion.near_px * judge.scale)
    polls = backend.poll(rivals, scene.matte, spoilt, rule)
    choice = ChoiceRule.of(params.fusion, judge.scale, maps.u.size)
    share = backend.choose(rivals, _grounds(judge, rivals, polls, glints), choice)
    return Fused(_continued(judge, maps.u, polls), share, maps.upload)


def _rivals(judge: _Judge, maps: Readings) -> Rivals:
    (left, right), backend, upload = judge.scene[:2], judge.backend, maps.upload
    for_upload, for_u = backend.evidence(left, right, (upload.u, maps.u))
    shown, u_shown = upload.valid & ~backend.unobserved(upload.u), ~backend.unobserved(maps.u)
    return Rivals(*upload, maps.u, for_upload, for_u, shown, u_shown)


def _grounds(judge: _Judge, rivals: Rivals, polls: Polls, glints: Mask) -> Grounds:
    params, edge = judge.params, judge.scene.edge
    trust = _trust(judge, polls)
    equal, usual = _compared(judge, polls)
    equal *= ramp(trust, params.min_trust, params.full_trust)
    planes = [pixels(cells, judge.scene.size, judge.backend) for cells in (trust, equal, usual)]
    beside = _grown(rivals.valid & ~rivals.upload_shown, _BESIDE_HIDDEN)
    return Grounds(
        planes[0],
        planes[1],
        planes[2],
        np.ones_like(rivals.u) if edge is None else edge,
        glints,
        beside,
    )


def _trust(judge: _Judge, polls: Polls) -> Cells:
    """T, 0 to 1 (R8)."""
    wide, far_share = judge.wide(judge.params.trust_width), judge.params.far_share
    agreed, voted = (
        blurred(cells, wide) + far_share * blurred(cells, _FAR * wide)
        for cells in (polls.agreed, polls.voted)
    )
    return ratio(agreed, voted)


def _compared(judge: _Judge, polls: Polls) -> tuple[Cells, Cells]:
    """Whether the upload's evidence is as good where both agree, and how much there is for GDR's map (R9)."""
    params = judge.params
    wide = judge.wide(params.evidence_width)
    number, lead, level = (
        blurred(cells, wide) + params.far_share * float(cells.mean())
        for cells in (polls.fair, polls.lead, polls.level)
    )
    return ramp(ratio(lead, level), -params.worse_by, -params.equal_within), ratio(level, number)


def _continued(judge: _Judge, u: Plane, polls: Polls) -> Plane:
    """GDR's map, bent towards the plane around it where the match lies outside of the right image (R7)."""
    params = judge.params
    window = max(4.0, params.reach * float(np.percentile(u[::CELL, ::CELL], 95)))
    fit = fit_planes(Sums(polls.shown, polls.of_u, polls.of_square), window)
    # Matches leave the right image only on its left.
    near = u[:, : int(u.max()) + 1]
    value, residual, support = (pixels(cells, near.shape, judge.backend) for cells in fit)
    limit = params.bend * np.maximum(near, 1)
    bend = np.clip(value - near, -limit, limit) / (1 + residual / params.flat_px**2)
    outside = (np.arange(near.shape[1]) < near) & (support > _TOUCHED)
    continued = u.copy()
    continued[:, : near.shape[1]] = np.where(outside, np.maximum(near + bend, 0), near)
    return continued


def _grown(mask: Mask, by: int) -> Mask:
    side = 2 * by + 1
    grown: Mask = cv2.dilate(mask.view(np.uint8), np.ones((side, side), np.uint8)).view(np.bool_)
    return grown.reshape(mask.shape)


def at_input_size(fused: Fused, upload: Sparse, near_px: float, backend: Backend) -> Plane:
    """Put both maps together at input size, (H, W) px: see `Backend.merge`."""
    return backend.merge(Offer(fused.u, fused.share, fused.upload.u), *upload, near_px)
