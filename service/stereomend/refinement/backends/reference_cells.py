"""Averages over wide windows, on a coarse grid: they change too slowly to be computed for every pixel.

What the choice between two maps is made on, and how a map is continued beyond the frame (R7 to R9).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stereomend.opencv import cv2
from stereomend.refinement.backends.data import (
    CELL,
    BendRule,
    Cells,
    Ground,
    GroundRule,
    Plane,
    Polls,
    Size,
)
from stereomend.refinement.backends.sizes import linear_weights, resized

_RIDGE = 0.02  # of the squared window: along a line, the slope across it stays near 0
_NOTHING = 1e-6  # a weight below which there is nothing to average
_TOUCHED = 1e-4  # support of a plane


def pixels(cells: Cells, size: Size) -> Cells:
    """The pixels (H, W) of a picture, bilinearly."""
    height, width = size
    whole = (cells.shape[0] * CELL, cells.shape[1] * CELL)
    return resized(linear_weights, cells, whole)[:height, :width]


def blurred(cells: Cells, width_px: float) -> Cells:
    """Gaussian mean with a standard deviation of `width_px` pixels; borders are mirrored."""
    sigma = max(width_px / CELL, 0.3)
    mean = cv2.GaussianBlur(cells, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
    return np.asarray(mean, np.float64).reshape(cells.shape)


def ratio(part: Cells, whole: Cells) -> Cells:
    """Part of the whole, 0 where the whole is next to nothing."""
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > _NOTHING)


def ramp(cells: Cells, low: float, high: float) -> Cells:
    """0 up to `low`, 1 from `high` on, linear between them."""
    return np.asarray(np.clip((cells - low) / max(high - low, 1e-9), 0, 1), np.float64)


class PlaneFit(NamedTuple):
    """The plane that fits best around each cell."""

    value: Cells
    """Of the plane at the cell."""
    residual: Cells
    """Weighted mean square of what the plane leaves."""
    support: Cells
    """Weight of what it was fitted to, 0 to 1."""


class Sums(NamedTuple):
    """Means over cells of what a plane is fitted to: how much is known, u over that, and u * u."""

    known: Cells
    of_u: Cells
    of_square: Cells


def fit_planes(sums: Sums, width_px: float) -> PlaneFit:
    """Fit a plane to the known pixels around each cell, under a Gaussian window of `width_px` (R7)."""
    share, of_u = sums.known, sums.of_u
    total = blurred(share, width_px)
    y, x = ((np.indices(share.shape) + 0.5) * CELL - 0.5) / width_px

    def mean(cells: Cells) -> Cells:
        return ratio(blurred(cells, width_px), total)

    at_x, at_y, at_u = mean(share * x), mean(share * y), mean(of_u)
    xx, yy = mean(share * x * x) - at_x**2 + _RIDGE, mean(share * y * y) - at_y**2 + _RIDGE
    xy, xu, yu = mean(share * x * y) - at_x * at_y, mean(of_u * x) - at_x * at_u, mean(of_u * y) - at_y * at_u
    determinant = np.maximum(xx * yy - xy**2, _RIDGE**2)
    along_x, along_y = (xu * yy - yu * xy) / determinant, (yu * xx - xu * xy) / determinant
    residual = np.maximum(mean(sums.of_square) - at_u**2 - along_x * xu - along_y * yu, 0)
    value = at_u + along_x * (x - at_x) + along_y * (y - at_y)
    return PlaneFit(value, residual, total)


def ground(polls: Polls, size: Size, rule: GroundRule) -> Ground:
    """See `Backend.ground`."""
    trust = _trust(polls, rule)
    equal, usual = _compared(polls, rule)
    equal *= ramp(trust, rule.min_trust, rule.full_trust)
    return Ground(*(pixels(cells, size) for cells in (trust, equal, usual)))


def _trust(polls: Polls, rule: GroundRule) -> Cells:
    agreed, voted = (
        blurred(cells, rule.trust) + rule.far_share * blurred(cells, rule.far * rule.trust)
        for cells in (polls.agreed, polls.voted)
    )
    return ratio(agreed, voted)


def _compared(polls: Polls, rule: GroundRule) -> tuple[Cells, Cells]:
    """Whether the upload's evidence is as good where both agree, and how much there is for GDR's map (R9)."""
    number, lead, level = (
        blurred(cells, rule.evidence) + rule.far_share * float(cells.mean())
        for cells in (polls.fair, polls.lead, polls.level)
    )
    return ramp(ratio(lead, level), -rule.worse_by, -rule.equal_within), ratio(level, number)


def bend(u: Plane, polls: Polls, rule: BendRule) -> Plane:
    """See `Backend.bend`."""
    fit = fit_planes(Sums(polls.shown, polls.of_u, polls.of_square), rule.window)
    value, residual, support = (pixels(cells, (u.shape[0], u.shape[1])) for cells in fit)
    limit = rule.bend * np.maximum(u, 1)
    step = np.clip(value - u, -limit, limit) / (1 + residual / rule.flat**2)
    outside = (np.arange(u.shape[1]) < u) & (support > _TOUCHED)
    return np.where(outside, np.maximum(u + step, 0), u)
