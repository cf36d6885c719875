"""Pictures for people: disparity and its error in perceptually uniform colours, small."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from stereomend.codec import Span, colourise
from stereomend.disparity import FloatMap, Image
from stereomend.evaluation.frame import Frame
from stereomend.evaluation.run import RAW, Maps
from stereomend.opencv import cv2

WORST_PX = 5.0
"""Errors are painted up to here."""
_WIDTH = 320  # px of a picture
# A sixth of what PNG needs; colours at full resolution, since they carry the values.
_JPEG = (
    *(cv2.IMWRITE_JPEG_QUALITY, 92),
    *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
)
_RAMP = np.linspace(0, 1, 256, dtype=np.float32)


class Picture(NamedTuple):
    """One picture with what is under it."""

    caption: str
    uri: str
    """`data:image/jpeg;base64,...`"""


@dataclass(frozen=True)
class Strip:
    """A method's maps of one frame over their errors, in columns: truth first, then the variants."""

    method: str
    maps: Sequence[Picture]
    errors: Sequence[Picture]


@dataclass(frozen=True)
class Sheet:
    """All pictures of one frame."""

    frame: str
    left: Picture
    truth: Picture
    low: str
    """Disparity at the dark end of the colours, px."""
    high: str
    strips: list[Strip] = field(default_factory=list)


class Gallery:
    """Collects the pictures of the first frames it is shown."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._sheets: dict[str, Sheet] = {}
        self.ramp = _encode(colourise(np.tile(_RAMP + 1, (12, 1)), Span(1, 2)))
        """The colours from low to high."""

    @property
    def sheets(self) -> list[Sheet]:
        """One per frame."""
        return list(self._sheets.values())

    def show(self, name: str, method: str, frame: Frame, maps: Maps) -> None:
        """Take a method's maps of a frame."""
        if name not in self._sheets and len(self._sheets) >= self._most:
            return
        span = _span(frame.truth)
        if name not in self._sheets:
            self._sheets[name] = _sheet(name, frame, span)
        self._sheets[name].strips.append(_strip(method, frame, maps, span))


def _span(truth: FloatMap) -> Span:
    known = truth[truth > 0]
    low, high = (float(value) for value in np.percentile(known, (1, 99))) if known.size else (0.0, 1.0)
    return Span(low, high) if high > low else Span(0.0, max(high, 1.0))


def _sheet(name: str, frame: Frame, span: Span) -> Sheet:
    left = Picture("left image", _encode(_shrunk(_eight_bit(frame.left), cv2.INTER_AREA)))
    truth = Picture("true disparity", _encode(_painted(frame.truth, span)))
    return Sheet(name, left, truth, f"{span.low:.1f}", f"{span.high:.1f}")


def _strip(method: str, frame: Frame, maps: Maps, span: Span) -> Strip:
    shown = {name: "as predicted" if name == RAW else name for name in maps}
    return Strip(
        method,
        [Picture(shown[name], _encode(_painted(one, span))) for name, one in maps.items()],
        [
            Picture(f"error, {shown[name]}", _encode(_paint_error(one, frame.truth)))
            for name, one in maps.items()
        ],
    )


def _paint_error(disparity: FloatMap, truth: FloatMap) -> Image:
    """Black where the truth is unknown; an exact value must not look so."""
    error = np.maximum(np.abs(disparity - truth), np.float32(1e-6))
    return _painted(np.where(truth > 0, error, np.float32(0)), Span(0, WORST_PX))


def _painted(disparity: FloatMap, span: Span) -> Image:
    """Pixels are left out and not mixed, which would make colours that stand for other values."""
    return _shrunk(colourise(disparity, span), cv2.INTER_NEAREST)


def _eight_bit(image: Image) -> Image:
    narrow = np.asarray(image / 257 if image.dtype == np.uint16 else image, np.uint8)
    return narrow if narrow.ndim == 3 else np.repeat(narrow[..., None], 3, axis=2)


def _shrunk(picture: Image, interpolation: int) -> Image:
    height, width = picture.shape[:2]
    if width <= _WIDTH:
        return picture
    size = _WIDTH, max(1, round(height * _WIDTH / width))
    return np.asarray(cv2.resize(picture, size, interpolation=interpolation), np.uint8)


def _encode(picture: Image) -> str:
    jpeg = cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), _JPEG)[1]
    return "data:image/jpeg;base64," + base64.b64encode(jpeg.tobytes()).decode()
