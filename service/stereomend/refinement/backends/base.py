"""What a backend does. All planes are (H, W); images are grey levels from 0 to 255, disparities pixels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Mask
from stereomend.refinement.stage_params import GdrParams, LdrParams

Plane = npt.NDArray[np.floating[Any]]
"""float32 (H, W) for `native`, float64 for `reference`."""

Size = tuple[int, int]
"""Height and width in pixels."""


class Usable(NamedTuple):
    """Which pixels count for the confidence, bool (H, W)."""

    valid: Mask
    """The disparity is known."""
    matte: Mask
    """No specular highlight."""


class Guide(NamedTuple):
    """What a solve is told besides the pair, each (H, W)."""

    edge: Plane | None = None
    """Weight of the smoothness, over 0 to 1; None: 1 everywhere."""
    prior: Plane | None = None
    """Where u is drawn to, px; None exactly if `trust` is."""
    trust: Plane | None = None
    """Weight of |u - prior|."""


UNGUIDED = Guide()


class OcclusionRule(NamedTuple):
    """When a run of unknown pixels in a row is the occlusion of the surface on its right."""

    step: float
    """The least rise of the disparity from its left to its right end, px."""
    stretch: float
    """Its largest length, in such rises."""
    slack: float
    """And so much more, px."""


class Reading(NamedTuple):
    """One way to see a left image, each (H, W)."""

    right: Plane
    u: Plane
    valid: Mask
    """Which pixels count."""


class Backend(Protocol):
    """The steps of LDR and GDR on one kind of hardware; the same numbers up to rounding."""

    name: str
    reason: str
    """Why this backend was taken."""
    kernel: str
    """A hash of the kernels' sources."""

    def plane(self, array: npt.NDArray[Any]) -> Plane:
        """Bring an array to the backend's precision; the caller's own is never changed later."""
        ...

    def shrink(self, image: Plane, size: Size) -> Plane:
        """Shrink to `size` by the area mean; further axes, as colour, stay."""
        ...

    def enlarge(self, image: Plane, size: Size) -> Plane:
        """Enlarge to `size` bilinearly, pixel centres at half, borders repeated."""
        ...

    def confidence(self, left: Plane, right: Plane, u: Plane, usable: Usable, params: LdrParams) -> Plane:
        """`C_f` (Eq. 1 to 4), in [0, 1], 0 where `u` is unknown."""
        ...

    def fill(self, u: Plane, known: Mask, steps: int, passes: int) -> Plane:
        """Replace what is not known by the median of known values met in eight directions.

        Up to `steps` steps each way, up to `passes` times; then the nearest known value (of equally near
        ones the leftmost, then the upper). With nothing known, `u` comes back as it is.
        """
        ...

    def solve(  # noqa: PLR0913 - what the model is made of
        self,
        left: Plane,
        right: Plane,
        u: Plane,
        params: GdrParams,
        *,
        weight: Plane | None = None,
        guide: Guide = UNGUIDED,
    ) -> Plane:
        """All warps of one level from `u`, with the dual variable starting at zero (Eq. 9 to 14, R3 to R5).

        `weight`, (H, W) in [0, 1], multiplies the data term; None is 1 everywhere.
        """
        ...

    def similarity(self, left: Plane, right: Plane, u: Plane) -> Plane:
        """Inner product of left and warped right descriptors, (H, W) in [-1, 1], 0 without contrast."""
        ...

    def fill_occlusions(self, u: Plane, known: Mask, rule: OcclusionRule) -> tuple[Plane, Mask]:
        """Give each occlusion among the unknown pixels the value on its left; and which those are (R2)."""
        ...

    def reach(self, seeds: Mask, passing: Mask, soft: Mask, u: Plane, step: float) -> Mask:
        """What can be walked to from `seeds`: along rows right and left, then columns down and up (R10).

        A step leads onto a `passing` pixel, and changes `u` by at most `step` px or touches a `soft` pixel.
        """
        ...

    def mismatch(self, left: Plane, readings: Sequence[Reading]) -> list[tuple[float, int]]:
        """Mean Euclidean distance, 0 to 2, of left and warped right signed descriptors; of how many pixels.

        For each reading, of those that are valid and not `unobserved`; (0, 0) where none is.
        """
        ...

    def unobserved(self, u: Plane) -> Mask:
        """Pixels (H, W) not seen in the right image: outside of it, or hidden.

        Hidden: a pixel further right in the row lands at least 1 px left of this one's column there.
        """
        ...
