"""One refined map against the truth of its phantom: everywhere, by visibility, and beside the instrument."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereomend.bench.quality_cases import QualityCase
from stereomend.disparity import FloatMap, Mask
from stereomend.evaluation.metrics import score
from stereomend.opencv import cv2
from stereomend.phantom import Phantom

EDGE_PX = 5.0
"""How far from the instrument's edge a pixel is still near it [px]."""


@dataclass(frozen=True)
class Scored:
    """One method on one case; an unknown pixel counts as disparity 0."""

    case: QualityCase
    method: str
    rmse: float
    """Over all pixels, px."""
    visible_rmse: float | None
    """Where the right camera sees the point too, px; None where there is no such pixel."""
    occluded_rmse: float | None
    """Where it does not, px."""
    bad3: float
    """Pixels off by more than 3 px, percent."""
    edge_bad3: float | None
    """The same of pixels near the instrument's edge; None where there is none."""
    ms: float
    """What the method took."""


def score_map(case: QualityCase, method: str, refined: FloatMap, phantom: Phantom, ms: float) -> Scored:
    """Score a map (H, W), px, against its phantom (raises ShapeMismatch for another size)."""
    whole = score(refined, phantom.truth)
    return Scored(
        case=case,
        method=method,
        rmse=whole.rmse,
        visible_rmse=_rmse_within(refined, phantom, ~phantom.occluded),
        occluded_rmse=_rmse_within(refined, phantom, phantom.occluded),
        bad3=whole.bad[3.0],
        edge_bad3=_bad3_within(refined, phantom, edge_band(phantom.instrument)),
        ms=ms,
    )


def _rmse_within(refined: FloatMap, phantom: Phantom, counted: Mask) -> float | None:
    return score(refined, phantom.truth, counted).rmse if counted.any() else None


def _bad3_within(refined: FloatMap, phantom: Phantom, counted: Mask) -> float | None:
    return score(refined, phantom.truth, counted).bad[3.0] if counted.any() else None


def edge_band(shown: Mask) -> Mask:
    """Pixels on either side whose nearest pixel of the other side is at most `EDGE_PX` away, (H, W)."""
    if shown.all() or not shown.any():
        return np.zeros_like(shown)
    inside, outside = shown.astype(np.uint8), (~shown).astype(np.uint8)
    to_outside, to_inside = (
        cv2.distanceTransform(side, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for side in (inside, outside)
    )
    return np.asarray(np.maximum(to_outside, to_inside) <= EDGE_PX)
