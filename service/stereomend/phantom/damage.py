"""Disparity maps broken as stereo networks break them, and maps that are already right.

All lengths scale with the picture and all errors with its disparities.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stereomend.disparity import DisparityMap, FloatMap, Mask
from stereomend.errors import InvalidParameter
from stereomend.opencv import cv2
from stereomend.phantom.scene import Phantom
from stereomend.phantom.spline import Single, smooth_noise

DAMAGES: tuple[str, ...] = ("spikes", "streaks", "holes", "border", "regions", "scale")
"""The kinds of damage that `break_disparity` knows, apart from "mixed"."""

GOOD: tuple[str, ...] = ("smooth", "blurred", "quantised", "exact")
"""The kinds of maps that `good_disparity` knows."""


@dataclass(frozen=True)
class _Job:
    """What a damage is done to."""

    phantom: Phantom
    rng: np.random.Generator

    @property
    def shape(self) -> tuple[int, int]:
        return self.phantom.pair.shape

    @property
    def size(self) -> float:
        """The length that features scale with, px."""
        return float(max(np.hypot(*self.shape) / 1.28, 1.0))

    @property
    def nearest(self) -> float:
        """The largest true disparity, px."""
        return float(self.phantom.truth.max())

    def noise(self, cell: float) -> Single:
        """Unit noise with features of a share `cell` of the picture."""
        return smooth_noise(self.rng, self.shape, max(cell * self.size, 1.0))

    def offset(self, low: float, high: float) -> float:
        """A wrong step up or down, of a share `low` to `high` of the largest disparity, px."""
        return float(self.rng.choice((-1, 1)) * self.rng.uniform(low, high) * self.nearest)


def break_disparity(phantom: Phantom, seed: int, kinds: Sequence[str] = ("mixed",)) -> DisparityMap:
    """The true disparity with the given damages, whatever their order.

    "mixed" is a typical network out of its domain: blurred edges and a wavy error of 0.5 to 1 px (where
    disparities reach 40 px) everywhere, then all damages but "scale". Unknown pixels hold 0, all others more.

    Args:
        phantom: whose truth to break.
        seed: at least 0; equal arguments give equal maps.
        kinds: names in `DAMAGES`, or "mixed".

    Raises:
        InvalidParameter: a kind is unknown, or the seed negative.
    """
    _check(seed, kinds, (*DAMAGES, "mixed"))
    values = phantom.truth.copy()
    if "mixed" in kinds:
        values = _learned(_Job(phantom, np.random.default_rng([seed, len(DAMAGES)])), values)
    for name in _ORDER:
        if name in kinds or ("mixed" in kinds and name != "scale"):
            values = _BREAKERS[name](
                _Job(phantom, np.random.default_rng([seed, DAMAGES.index(name)])), values
            )
    return DisparityMap.from_array(values)


def good_disparity(phantom: Phantom, seed: int, kind: str = "smooth") -> DisparityMap:
    """A map that is already right, to see that refinement does no harm; known everywhere.

    Args:
        phantom: whose truth to take.
        seed: at least 0; only "smooth" depends on it.
        kind: "smooth" (a smooth error of 0.3 px RMS), "blurred" (depth edges smeared over a few pixels),
            "quantised" (whole pixels, at least 1) or "exact".

    Raises:
        InvalidParameter: the kind is unknown, or the seed negative.
    """
    _check(seed, (kind,), GOOD)
    job = _Job(phantom, np.random.default_rng([seed, 99]))
    return DisparityMap.from_array(_MAKERS[kind](job, phantom.truth.copy()))


def _check(seed: int, kinds: Sequence[str], known: Sequence[str]) -> None:
    """Refuse unknown kinds and negative seeds."""
    unknown = [kind for kind in kinds if kind not in known]
    if unknown:
        raise InvalidParameter(
            f"no damage or kind of map is called {unknown[0]!r}; known are {', '.join(known)}"
        )
    if seed < 0:
        raise InvalidParameter(f"seed is {seed}; expected 0 or more")


def _positive(values: npt.NDArray[np.floating], nearest: float) -> FloatMap:
    """Known values must stay known: at least 2 % of the largest true disparity."""
    return np.asarray(np.maximum(values, 0.02 * nearest), np.float32)


def _blur(image: npt.NDArray[np.floating], sigma: float) -> Single:
    blurred = cv2.GaussianBlur(image.astype(np.float32), (0, 0), max(sigma, 0.3))
    # OpenCV drops an axis of length 1.
    return np.asarray(blurred, np.float32).reshape(image.shape)


def _learned(job: _Job, values: FloatMap) -> FloatMap:
    """What every learned matcher does: soft depth edges, a wavy error, blotches of a finer one."""
    soft = _blur(values, job.rng.uniform(0.004, 0.009) * job.size)
    rms = job.rng.uniform(0.5, 1.0) * job.nearest / 40
    blotches = job.noise(0.03) * np.clip(job.noise(0.15), 0, None)
    wavy = job.noise(0.12) + 0.6 * blotches
    return _positive(soft + rms * wavy / max(float(np.sqrt(np.mean(wavy**2))), 1e-6), job.nearest)


def _regions(job: _Job, values: FloatMap) -> FloatMap:
    """Blobs of 2 to 8 % of the picture each, whose smooth values are off by several to dozens of pixels."""
    y, x = np.mgrid[: job.shape[0], : job.shape[1]].astype(np.float32)
    for _ in range(job.rng.integers(2, 5)):
        radius = np.sqrt(job.rng.uniform(0.02, 0.08) / np.pi * job.shape[0] * job.shape[1])
        cx, cy = job.rng.uniform(0, 1, 2) * (job.shape[1], job.shape[0])
        ragged = 1 + 0.22 * job.noise(0.08) + 0.06 * job.noise(0.025)
        inwards = radius * ragged - np.hypot(x - cx, (y - cy) * job.rng.uniform(0.7, 1.4))
        share = np.clip(inwards / (job.rng.uniform(0.004, 0.02) * job.size), 0, 1)
        wrong = _blur(values, 0.03 * job.size) + job.offset(0.18, 0.6) * (1 + 0.2 * job.noise(0.1))
        values = np.where(share > 0, (1 - share) * values + share * wrong, values).astype(np.float32)
    return _positive(values, job.nearest)


def _streaks(job: _Job, values: FloatMap) -> FloatMap:
    """Horizontal runs, a few rows high, that drag a wrong value along and slowly let go of it."""
    height, width = job.shape
    values = values.copy()
    for _ in range(max(1, round(0.045 * height))):
        row, start = int(job.rng.integers(height)), int(job.rng.integers(width))
        length = max(1, round(job.rng.uniform(0.04, 0.3) * width))
        rows = slice(row, row + int(job.rng.integers(1, 2 + max(1, round(0.008 * height)))))
        run = values[rows, start : start + length]
        held = float(run[0, 0]) + job.offset(0.1, 0.45)
        grip = np.minimum(1, np.linspace(2.5, 0.6, run.shape[1], dtype=np.float32))
        values[rows, start : start + length] = run + grip * (held - run)
    return _positive(values, job.nearest)


def _spikes(job: _Job, values: FloatMap) -> FloatMap:
    """Single pixels and small clusters, 1.5 % of the map, anywhere in the range that a network searches."""
    grain = job.rng.uniform(size=job.shape)
    lone = grain < 0.006
    radius = max(1, round(0.0025 * job.size))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    seeds = (grain > 1 - 0.012 / kernel.sum()).astype(np.uint8)
    cluster = cv2.dilate(seeds, kernel).astype(bool) & (job.rng.uniform(size=job.shape) < 0.85)
    wild = job.rng.uniform(0.05, 1.6, job.shape) * job.nearest
    level = np.clip(0.8 + 0.7 * job.noise(0.01), 0.05, 1.6) * job.nearest
    wrong = np.where(cluster, level + 0.1 * (wild - level), wild)
    # A spike near the true value would be none.
    gap = 0.15 * job.nearest
    wrong = np.where(np.abs(wrong - values) < gap, values + 2 * gap, wrong)
    return _positive(np.where(lone | cluster, wrong, values), job.nearest)


def _border(job: _Job, values: FloatMap) -> FloatMap:
    """The left band, matched outside the right image: smeared, wrong or unknown, in turns downwards."""
    width = job.shape[1]
    columns = np.arange(width)[None, :]
    reach = job.phantom.truth * (1 + 0.12 * job.noise(0.02))
    band = columns < np.minimum(reach, 0.5 * width)
    edge = np.minimum(np.argmin(band, axis=1), width - 1)
    held = values[np.arange(job.shape[0]), edge][:, None]
    jitter = _blur(job.rng.standard_normal((job.shape[0], 1)), 0.003 * job.size)
    smeared = held * (1 + 0.1 * jitter / max(float(jitter.std()), 1e-6)) - 0.3 * job.nearest * (
        edge[:, None] - columns
    ) / max(float(edge.max()), 1.0)
    wild = job.nearest * np.clip(0.35 + 0.3 * job.noise(0.008), 0.03, 1.2)
    return _in_turns(job, band, values, (_positive(smeared, job.nearest), _positive(wild, job.nearest)))


def _in_turns(job: _Job, band: Mask, values: FloatMap, wrong: tuple[FloatMap, FloatMap]) -> FloatMap:
    """The band filled from one of two wrong maps or with 0, one after the other down the picture."""
    turn = job.rng.permutation(3)
    waves = smooth_noise(job.rng, (job.shape[0], 1), max(0.25 * job.size, 1.0))
    choice = turn[np.digitize(waves, (-0.5, 0.7))]
    filled = np.select([choice == 0, choice == 1], wrong, np.float32(0))
    return np.where(band, filled, values).astype(np.float32)


def _holes(job: _Job, values: FloatMap) -> FloatMap:
    """Unknown at highlights as the left picture shows them, and a little around."""
    bright = job.phantom.pair.left.min(axis=-1) >= 225
    radius = max(1, round(0.003 * job.size))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    around = cv2.dilate(bright.astype(np.uint8), kernel) > 0
    # Neighbouring glints grow together into one ragged hole.
    crowded = _blur(bright, 0.01 * job.size) > 0.12 * np.clip(1 + 0.4 * job.noise(0.01), 0.3, 2)
    return np.where(around | crowded, 0, values).astype(np.float32)


def _scale(job: _Job, values: FloatMap) -> FloatMap:
    """The scale is lost: all known values times 0.5 to 0.8 or 1.2 to 2, and shifted a little."""
    factor = job.rng.uniform(0.5, 0.8) if job.rng.uniform() < 0.5 else job.rng.uniform(1.2, 2)
    moved = _positive(factor * values + job.offset(0, 0.05), job.nearest)
    return np.where(values > 0, moved, 0).astype(np.float32)


_Change = Callable[[_Job, FloatMap], FloatMap]

_BREAKERS: dict[str, _Change] = {
    "spikes": _spikes,
    "streaks": _streaks,
    "holes": _holes,
    "border": _border,
    "regions": _regions,
    "scale": _scale,
}
# Later damage lies over earlier: what is unknown must stay so.
_ORDER = ("regions", "streaks", "spikes", "border", "holes", "scale")


def _smooth(job: _Job, values: FloatMap) -> FloatMap:
    wavy = job.noise(0.08) + 0.3 * job.noise(0.015)
    return _positive(values + 0.3 * wavy / max(float(np.sqrt(np.mean(wavy**2))), 1e-6), job.nearest)


def _blurred(job: _Job, values: FloatMap) -> FloatMap:
    return _blur(values, 0.004 * job.size)


def _quantised(_: _Job, values: FloatMap) -> FloatMap:
    return np.maximum(np.rint(values), 1)


def _exact(_: _Job, values: FloatMap) -> FloatMap:
    return values


_MAKERS: dict[str, _Change] = {
    "smooth": _smooth,
    "blurred": _blurred,
    "quantised": _quantised,
    "exact": _exact,
}
