"""The choice, pixel by pixel, between the upload and what GDR found (R7 to R10 of `docs/robust.md`).

What was uploaded stays where it is as good as what refinement can reach, so that a good map is never made
worse.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Mask
from stereomend.opencv import cv2
from stereomend.refinement.backends import (
    CELL,
    HALF,
    Backend,
    BendRule,
    ChoiceRule,
    GroundRule,
    Grounds,
    Offer,
    Plane,
    PollRule,
    Polls,
    Rivals,
)
from stereomend.refinement.params import RefineParams
from stereomend.refinement.pyramid import Sparse
from stereomend.refinement.scene import Scene, in_bands
from stereomend.refinement.stage_params import FusionParams

_AROUND_HIDDEN = 2  # px that a descriptor and its window see of what is hidden
_BESIDE_HIDDEN = 4  # px that a window sees of it where two readings are compared
_WINDOW = 27, 7  # px, and rows `ROWS_APART`; a few matches of GDR's together may be there by chance
_AROUND_GLINTS = 4  # px


ROWS_APART = 4


class Readings(NamedTuple):
    """The two maps at working size, px."""

    upload: Sparse
    """Sampled, not averaged: a mean of two surfaces would lie on neither."""
    u: Plane
    grain_px: float
    """What values of the upload are whole multiples of, px of the input; 0: of nothing."""


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


def fuse(scene: Scene, maps: Readings, params: RefineParams, backend: Backend) -> Fused:
    """Choose between the upload and GDR's map."""
    judge = _Judge(scene, params.fusion, params.processing_scale, backend)
    rivals, hidden = _rivals(judge, maps)
    glints = _grown(~scene.matte, _AROUND_GLINTS)
    spoilt = glints | _grown(~(rivals.upload_shown & rivals.u_shown), _AROUND_HIDDEN)
    polls = backend.poll(rivals, scene.matte, spoilt, PollRule.of(params.fusion, judge.scale))
    choice = ChoiceRule.of(params.fusion, judge.scale, maps.u.size, maps.grain_px)
    share = backend.choose(rivals, _grounds(judge, rivals, polls, glints, hidden), choice)
    kept = without_chance(share, rivals, params.fusion.least_believed)
    return Fused(_continued(judge, maps.u, polls), kept, maps.upload)


def _rivals(judge: _Judge, maps: Readings) -> tuple[Rivals, Mask]:
    """Both maps, and what the upload hides or hardly shows, (H, W)."""
    (left, right), backend, upload = judge.scene[:2], judge.backend, maps.upload
    for_upload, for_u = backend.evidence(left, right, (upload.u, maps.u))
    shown, hidden = backend.shown(upload)
    return Rivals(*upload, maps.u, for_upload, for_u, shown, ~backend.unobserved(maps.u)), hidden


def _grounds(judge: _Judge, rivals: Rivals, polls: Polls, glints: Mask, hidden: Mask) -> Grounds:
    scene, backend = judge.scene, judge.backend
    level, equal, usual = backend.ground(polls, scene.size, GroundRule.of(judge.params, scene.size[1]))
    edge = np.ones_like(rivals.u) if scene.edge is None else scene.edge
    inside = hidden & ~_grown(~hidden, _BESIDE_HIDDEN)
    beside = _grown(hidden, _BESIDE_HIDDEN) & ~(inside & _seen_through(judge, rivals, hidden, usual))
    return Grounds(level, equal, usual, edge, glints, beside)


def _seen_through(judge: _Judge, rivals: Rivals, hidden: Mask, usual: Plane) -> Mask:
    """Where GDR really sees something else in most of what the upload hides around, (H, W)."""
    params, some = judge.params, slice(None, None, ROWS_APART)  # they tell as much as all
    upload, u, n = (plane[some] for plane in (rivals.upload, rivals.u, rivals.for_u))
    apart = np.abs(upload - u) >= params.near_px * judge.scale
    seen = hidden[some] & rivals.u_shown[some] & apart & (n >= params.weak_share * usual[some])
    return np.repeat(mostly(seen, hidden[some]), ROWS_APART, axis=0)[: hidden.shape[0]]


def mostly(part: Mask, whole: Mask) -> Mask:
    """Where more than half of `whole` around is `part`; of every `ROWS_APART`th row of a picture, (H, W)."""
    return np.asarray(2 * _count_around(part) > _count_around(whole), np.bool_)


def _count_around(mask: Mask) -> npt.NDArray[np.uint16]:
    counts = cv2.boxFilter(np.ascontiguousarray(mask).view(np.uint8), cv2.CV_16U, _WINDOW, normalize=False)
    return np.asarray(counts, np.uint16).reshape(mask.shape)


def without_chance(share: Plane, rivals: Rivals, least: float) -> Plane:
    """The share (H, W), and 0 beyond the right image's frame if less than `least` there is believed.

    A part that joins what both maps agree on does so by chance where the rest does not.
    """
    strip = np.s_[:, : max(1, int(rivals.u.max()) + 1)]
    u, shown, part = rivals.u[strip], rivals.upload_shown[strip], share[strip]
    beyond = (np.arange(u.shape[1]) < u) & ~shown
    believed = beyond & (part > HALF)
    if np.count_nonzero(believed) >= least * np.count_nonzero(beyond):
        return share
    kept = share.copy()
    kept[strip][beyond] = 0
    return kept


def _continued(judge: _Judge, u: Plane, polls: Polls) -> Plane:
    """GDR's map, bent towards the plane around it where the match lies outside of the right image (R7)."""
    params = judge.params
    # Matches leave the right image only on its left, as far as disparities reach.
    window = max(4.0, params.reach * float(np.percentile(u[::CELL, ::CELL], 95)))
    return judge.backend.bend(u, polls, BendRule(window, params.bend, params.flat_px))


def grain_of(upload: Sparse) -> float:
    """1 if the upload (H, W) is in whole pixels, as maps of 8 bits are, else 0."""
    return float(all((band == np.rint(band)).all() for band in in_bands(upload.u)))


def _grown(mask: Mask, by: int) -> Mask:
    side = 2 * by + 1
    grown: Mask = cv2.dilate(mask.view(np.uint8), np.ones((side, side), np.uint8)).view(np.bool_)
    return grown.reshape(mask.shape)


def at_input_size(fused: Fused, upload: Sparse, near_px: float, backend: Backend) -> Plane:
    """Put both maps together at input size, (H, W) px: see `Backend.merge`."""
    return backend.merge(Offer(fused.u, fused.share, fused.upload.u), *upload, near_px)
