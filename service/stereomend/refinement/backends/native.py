"""The C++ kernels, float32, on all cores given."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from stereomend import _native
from stereomend.disparity import FloatMap, Mask
from stereomend.opencv import cv2
from stereomend.refinement.backends.base import Plane, Reading, Size, Usable
from stereomend.refinement.params import GdrParams, LdrParams


class NativeBackend:
    """Implements `Backend`; results are bitwise equal for any number of threads."""

    name = "native"
    kernel = _native.KERNEL_HASH

    def __init__(self, threads: int, reason: str) -> None:
        self._engine = _native.Engine(threads)
        self.reason = reason

    def plane(self, array: npt.NDArray[Any]) -> FloatMap:
        """See `Backend.plane`."""
        return np.ascontiguousarray(array, np.float32)

    def shrink(self, image: Plane, size: Size) -> Plane:
        """See `Backend.shrink`."""
        return _resize(image, size, cv2.INTER_AREA)

    def enlarge(self, image: Plane, size: Size) -> Plane:
        """See `Backend.enlarge`."""
        return _resize(image, size, cv2.INTER_LINEAR)

    def confidence(self, left: Plane, right: Plane, u: Plane, usable: Usable, params: LdrParams) -> Plane:
        """See `Backend.confidence`."""
        planes = (self.plane(left), self.plane(right), self.plane(u))
        constants = _native.ConfidenceParams(
            window=params.window,
            smoothness_weight=params.smoothness_weight,
            smoothness_power=params.smoothness_power,
            photometric_weight=params.photometric_weight,
        )
        return self._engine.confidence(*planes, usable.valid, usable.matte, constants)

    def fill(self, u: Plane, known: Mask, steps: int, passes: int) -> Plane:
        """See `Backend.fill`."""
        return self._engine.fill(self.plane(u), known, steps, passes)

    def solve(
        self, left: Plane, right: Plane, u: Plane, params: GdrParams, weight: Plane | None = None
    ) -> Plane:
        """See `Backend.solve`."""
        constants = _native.SolverParams(
            data_weight=params.data_weight,
            huber_epsilon=params.huber_epsilon,
            tau=params.tau,
            sigma=params.sigma,
            warps=params.warps,
            iterations=params.iterations,
            absolute=params.descriptor == "absolute",
        )
        share = None if weight is None else self.plane(weight)
        return self._engine.solve(self.plane(left), self.plane(right), self.plane(u), share, constants)

    def mismatch(self, left: Plane, readings: Sequence[Reading]) -> list[tuple[float, int]]:
        """See `Backend.mismatch`."""
        planes = [(self.plane(right), self.plane(u), valid) for right, u, valid in readings]
        return self._engine.mismatch(self.plane(left), planes)

    def unobserved(self, u: Plane) -> Mask:
        """See `Backend.unobserved`."""
        return self._engine.unobserved(self.plane(u))


def _resize(image: Plane, size: Size, interpolation: int) -> Plane:
    height, width = size
    return np.asarray(cv2.resize(image, (width, height), interpolation=interpolation), np.float32)
