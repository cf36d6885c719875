"""What refined maps are compared with: filters and OpenCV's variational refinement, beside every preset."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from stereomend.disparity import DisparityMap, FloatMap, Image, StereoPair
from stereomend.opencv import cv2
from stereomend.refinement import Backend, RefineParams, parse_params, run, select_backend

Method = Callable[[StereoPair, DisparityMap], FloatMap]
"""Takes a pair, uint8, and a map of it with at least one known pixel; gives a map (H, W), px."""

INPUT = "input"
"""The method that leaves the map as it is."""
BILATERAL_RADIUS = 5
"""Of the window [px]."""
BILATERAL_SPACE = 3.0
"""Standard deviation of the weight by distance [px]."""
BILATERAL_COLOUR = 12.0
"""Standard deviation of the weight by difference of colour, summed over the channels [grey levels of 255]."""
VARIATIONAL_WARPS = 5
"""Each with as many fixed-point iterations as OpenCV's default."""
VARIATIONAL_SWEEPS = 25
"""Of each fixed-point iteration; OpenCV's 5 leave a constant error where it is."""


def methods_of(presets: Iterable[str], overrides: Mapping[str, Any]) -> dict[str, Method]:
    """All that is compared, by name: the input, filters, then each preset with `overrides` such as `gdr`.

    Raises:
        InvalidParameter: a preset is unknown, or an override unknown or out of range.
    """
    backend = select_backend("auto")
    params = {name: parse_params({**overrides, "preset": name}) for name in presets}
    refined = {name: partial(_refined, params=found, backend=backend) for name, found in params.items()}
    return _BASELINES | refined


def _refined(pair: StereoPair, upload: DisparityMap, params: RefineParams, backend: Backend) -> FloatMap:
    return run(pair, upload, params, backend).disparity


def nearest_filled(upload: DisparityMap) -> FloatMap:
    """The map with each unknown pixel given the value of the nearest known one; at least one is known."""
    unknown = (~upload.valid).astype(np.uint8)
    _, labels = cv2.distanceTransformWithLabels(unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    by_label = np.zeros(int(labels.max()) + 1, np.float32)
    by_label[labels[upload.valid]] = upload.values[upload.valid]
    return np.asarray(by_label[labels])


def joint_bilateral(values: FloatMap, guide: Image) -> FloatMap:
    """Average a map (H, W) over a square window, by distance and by likeness in the guide.

    The weights are Gaussians of the distance in px and of the difference summed over the channels of
    `guide`, uint8 (H, W, 3); pixels outside the image do not count. As OpenCV's `jointBilateralFilter`, which
    the headless package leaves out (Petschnigg et al. 2004, doi:10.1145/1015706.1015777).
    """
    radius = BILATERAL_RADIUS
    likeness = _gaussian(np.arange(3 * 255 + 1), BILATERAL_COLOUR)
    closeness = _gaussian(np.arange(-radius, radius + 1), BILATERAL_SPACE)
    channels = np.ascontiguousarray(guide.transpose(2, 0, 1), np.int16)
    total, weights = np.zeros_like(values), np.zeros_like(values)
    for dy, dx in product(range(-radius, radius + 1), repeat=2):
        here, there = _overlap(values.shape, dy, dx), _overlap(values.shape, -dy, -dx)
        difference = np.abs(channels[:, *here] - channels[:, *there]).sum(axis=0)
        weight = closeness[dy + radius] * closeness[dx + radius] * likeness[difference]
        total[here] += weight * values[there]
        weights[here] += weight
    return np.asarray(total / weights)


def _gaussian(x: npt.NDArray[np.int_], deviation: float) -> FloatMap:
    weight: FloatMap = np.exp(-((x / deviation) ** 2) / 2).astype(np.float32)
    return weight


def _overlap(shape: tuple[int, ...], dy: int, dx: int) -> tuple[slice, slice]:
    """The pixels of an image that have a neighbour `dy` rows down and `dx` columns to the right."""
    height, width = shape
    return (
        slice(max(-dy, 0), max(height - max(dy, 0), 0)),
        slice(max(-dx, 0), max(width - max(dx, 0), 0)),
    )


def variational(values: FloatMap, pair: StereoPair) -> FloatMap:
    """OpenCV's `VariationalRefinement` of an optical flow, from the map (H, W) on, at full size.

    The flow from the left image to the right one is u = -d, v = 0. The solver moves both, so v is put back
    to 0 before each warp: a rectified pair has none.
    """
    solver = cv2.VariationalRefinement.create()
    solver.setSorIterations(VARIATIONAL_SWEEPS)
    left, right = (cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (pair.left, pair.right))
    u: npt.NDArray[Any] = -values
    for _ in range(VARIATIONAL_WARPS):
        u, _ = solver.calcUV(left, right, u, np.zeros_like(u))
    return np.asarray(np.maximum(-u, 0), np.float32)


_BASELINES: dict[str, Method] = {
    INPUT: lambda _, upload: upload.values,
    "filled": lambda _, upload: nearest_filled(upload),
    "median": lambda _, upload: np.asarray(cv2.medianBlur(nearest_filled(upload), 5), np.float32),
    "bilateral": lambda pair, upload: joint_bilateral(nearest_filled(upload), pair.left),
    "variational": lambda pair, upload: variational(nearest_filled(upload), pair),
}
