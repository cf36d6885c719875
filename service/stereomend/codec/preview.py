"""A picture of a disparity map for people: perceptually uniform colours and a bar that tells their values."""

from __future__ import annotations

from itertools import count
from math import gcd
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stereomend.disparity import FloatMap
from stereomend.opencv import cv2

Picture = npt.NDArray[np.uint8]

_WHITE = (255, 255, 255)
_LEAST_HEIGHT = 96  # px, so that the numbers beside the bar fit
_FONT_HEIGHT = 480  # px of picture height per unit of text scale
_LEAST_SPAN = 1e-6  # of the largest value; less is a flat map, whose bar starts at 0
_SAMPLES = 1 << 18  # pixels that the range is taken from; percentiles of more take longer and say the same


class Span(NamedTuple):
    """The disparities, in px, at both ends of the colours."""

    low: float
    high: float


def colourise(disparity: FloatMap, span: Span | None = None) -> Picture:
    """Paint a disparity map: violet far, yellow near (viridis), black where unknown.

    By default the colours span the 1st to the 99th percentile of the known values, so that outliers do not
    flatten the rest.

    Args:
        disparity: shape (H, W), pixels; unknown where not finite or not above 0.
        span: what the colours span, to compare several maps.

    Returns:
        uint8, shape (H, W, 3), RGB.
    """
    return _paint(disparity, span or _robust_range(disparity))


def preview_picture(disparity: FloatMap) -> Picture:
    """Paint a disparity map as `colourise` does and put a bar with its values in px at the right side.

    Args:
        disparity: shape (H, W), pixels; unknown where not finite or not above 0.

    Returns:
        uint8, shape (H', W', 3), RGB; the map is the upper left part, and H' is H or 96, whichever is more.
    """
    span = _robust_range(disparity)
    bar = _bar(max(disparity.shape[0], _LEAST_HEIGHT), span)
    picture = np.zeros((bar.shape[0], disparity.shape[1] + bar.shape[1], 3), np.uint8)
    picture[: disparity.shape[0], : disparity.shape[1]] = _paint(disparity, span)
    picture[:, disparity.shape[1] :] = bar
    return picture


def _robust_range(disparity: FloatMap) -> Span:
    steps = count(1 + disparity.size // _SAMPLES)
    # A step that shares no divisor with the width meets all columns.
    step = next(step for step in steps if gcd(step, disparity.shape[1]) == 1)
    sample = disparity.reshape(-1)[::step]
    sample = sample[_known(sample)]
    if sample.size == 0:
        return Span(0.0, 1.0)
    low, high = (float(value) for value in np.percentile(sample, (1, 99)))
    return Span(low if high - low > _LEAST_SPAN * high else 0.0, high)


def _known(disparity: FloatMap) -> npt.NDArray[np.bool_]:
    return np.isfinite(disparity) & (disparity > 0)


def _paint(disparity: FloatMap, span: Span) -> Picture:
    known = _known(disparity)
    values = np.clip(np.where(known, disparity, span.low), span.low, span.high)
    shares = np.clip((values - span.low) / (span.high - span.low), 0, 1)
    levels = np.rint(shares * 255).astype(np.uint8)
    painted = cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS)
    picture = np.asarray(cv2.cvtColor(painted, cv2.COLOR_BGR2RGB), np.uint8)
    picture[~known] = 0
    return picture


def _bar(height: int, span: Span) -> Picture:
    """Return the bar, largest value at the top, with three numbers."""
    scale = max(0.4, height / _FONT_HEIGHT * 0.5)
    texts = [f"{value:.4g} px" for value in (span.high, (span.low + span.high) / 2, span.low)]
    line = round(22 * scale)  # a capital letter of this font is 22 px high
    width = max(cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)[0][0] for text in texts)
    bar = np.zeros((height, width + 4 * line, 3), np.uint8)
    ramp = np.linspace(span.high, span.low, height - 2 * line, dtype=np.float32)
    bar[line:-line, line : 2 * line] = _paint(np.repeat(ramp[:, None], line, axis=1), span)
    for text, share in zip(texts, (0.0, 0.5, 1.0), strict=True):
        place = round(2.5 * line), round(line + share * (height - 2 * line) + line / 2)
        cv2.putText(bar, text, place, cv2.FONT_HERSHEY_SIMPLEX, scale, _WHITE, 1, cv2.LINE_AA)
    return bar
