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

SMALLEST = 0.5
"""A smaller disparity [px] is a network's way to say that it knows nothing."""

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


class ReuseRule(NamedTuple):
    """When another map replaces the one at hand (R6)."""

    margin: float
    """Its evidence is larger by more than this."""
    least: float = 0.3
    """And its evidence is over this: a map that the pair contradicts replaces nothing."""
    apart: float = 0.5
    """And the two differ by more than this, px; nearer readings compete in the solver itself."""


class SpeckleRule(NamedTuple):
    """Which patches of a map are too small to be a surface."""

    largest: int
    """The most pixels of such a patch."""
    step: float = 1.0
    """The largest difference of neighbours inside of a patch, px."""

    @classmethod
    def of(cls, share: float, u: Plane) -> SpeckleRule:
        """Patches of `u` up to a share of the picture."""
        return cls(int(share * u.size))


class Reading(NamedTuple):
    """One way to see a left image, each (H, W)."""

    right: Plane
    u: Plane
    valid: Mask
    """Which pixels count."""


class Problem(NamedTuple):
    """What GDR is given, each (H, W) at working size."""

    left: Plane
    right: Plane
    channels: tuple[Plane, ...]
    """Of the left image: grey, or R, G and B."""
    prior: Plane
    """Where the coarsest level starts, and what u is drawn to where there is trust, px."""
    trust: Plane | None = None
    """Weight of |u - prior|; None: it only starts."""
    edge: Plane | None = None
    """Weight of the smoothness, over 0 to 1; None: 1 everywhere."""
    weight: Plane | None = None
    """Of the data term, 0 to 1; None: 1 everywhere."""

    @property
    def size(self) -> Size:
        """Height and width in pixels."""
        return self.left.shape[0], self.left.shape[1]


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

    def globally(self, problem: Problem, params: GdrParams) -> Plane:
        """All of GDR from coarse to fine (Eq. 9 to 14, R3 to R6), (H, W) px.

        What the levels make of each other is said in `coarse_to_fine`, which backends without a memory of
        their own share.
        """
        ...

    def evidence(self, left: Plane, right: Plane, maps: Sequence[Plane]) -> list[Plane]:
        """n(u) of each map u, (H, W) in [-1, 1] (R1).

        The inner product of left and warped right descriptors, 0 without contrast, averaged over 5 x 5
        pixels; borders are mirrored. Two maps at once take less time than one after the other.
        """
        ...

    def better(self, left: Plane, right: Plane, u: Plane, other: Plane, rule: ReuseRule) -> Plane:
        """`u`, or `other` where the pair speaks for it far more and shows the pixel (R6)."""
        ...

    def halve(self, planes: Sequence[Plane]) -> list[Plane]:
        """Planes of one size at half of it, sides rounded up, by the area mean."""
        ...

    def halve_weighed(self, u: Plane, weight: Plane) -> tuple[Plane, Plane]:
        """Disparities, in pixels of the smaller size, and their weights at half of the size.

        `u` is averaged with the weight, so that what has none does not smear over what has; where nothing
        has any, all counts alike.
        """
        ...

    def evidence_confidence(
        self, left: Plane, right: Plane, u: Plane, usable: Usable, params: LdrParams
    ) -> Plane:
        """c, (H, W) in [0, 1] (R1): evidence and smoothness.

        0 where `u` is not usable or at most `SMALLEST`, where the right image does not show the pixel, and
        in speckles of `params.speckle_share`.
        """
        ...

    def speckles(self, u: Plane, valid: Mask, rule: SpeckleRule) -> Mask:
        """Valid pixels, (H, W), of patches of at most `rule.largest` pixels.

        A patch goes on from a pixel to the next in its row or column as long as `u` changes by at most
        `rule.step`.
        """
        ...

    def edge_weights(self, channels: Sequence[Plane], params: GdrParams) -> Plane:
        """w, (H, W) over 0 to 1 (R4), from 1 to 3 planes of levels, 0 to 255: the steepest counts."""
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
