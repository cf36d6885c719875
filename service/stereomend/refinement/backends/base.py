"""What a backend does. All planes are (H, W); images are grey levels from 0 to 255, disparities pixels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Image, Mask
from stereomend.refinement.backends.data import (
    UNGUIDED,
    BendRule,
    ChoiceRule,
    GlintRule,
    Ground,
    GroundRule,
    Grounds,
    Guide,
    OcclusionRule,
    Offer,
    Origins,
    Plane,
    PollRule,
    Polls,
    Problem,
    Reading,
    ReuseRule,
    Rivals,
    Size,
    Solved,
    Sparse,
    SpeckleRule,
    Tick,
    Usable,
)
from stereomend.refinement.stage_params import GdrParams, LdrParams


class Backend(Protocol):
    """The steps of LDR and GDR on one kind of hardware; the same numbers up to rounding."""

    name: str
    reason: str
    """Why this backend was taken."""
    kernel: str
    """A hash of the kernels' sources."""

    @property
    def alone(self) -> Backend:
        """The same on the calling thread alone: for while the other cores are busy with something else."""
        ...

    def plane(self, array: npt.NDArray[Any]) -> Plane:
        """Bring an array to the backend's precision; the caller's own is never changed later."""
        ...

    def shrink(self, image: Plane | Mask, size: Size) -> Plane:
        """Shrink to `size` by the area mean."""
        ...

    def shrink_sparse(self, sparse: Sparse, size: Size) -> Sparse:
        """The area mean over valid pixels, times the width ratio; valid where half of the area is."""
        ...

    def sample_sparse(self, sparse: Sparse, size: Size) -> Sparse:
        """Without averaging, times the width ratio: a pixel's centre falls on the one that it takes."""
        ...

    def shades(self, image: Image, size: Size) -> tuple[list[Plane], Plane]:
        """Grey alone, or R, G and B, of an image shrunk to `size`; and the BT.601 grey levels of these."""
        ...

    def grey(self, image: Image, size: Size) -> Plane:
        """BT.601 grey levels of an image, then shrunk to `size`: another rounding than that of `shades`."""
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
        tick: Tick | None = None,
    ) -> Plane:
        """All warps of one level from `u`, with the dual variable starting at zero (Eq. 9 to 14, R3 to R5).

        `weight`, (H, W) in [0, 1], multiplies the data term; None is 1 everywhere.
        """
        ...

    def globally(self, problem: Problem, params: GdrParams, tick: Tick | None = None) -> Solved:
        """All of GDR from coarse to fine (Eq. 9 to 14, R3 to R6).

        What the levels make of each other is said in `coarse_to_fine`, which backends without a memory of
        their own share; on a device no `tick` is heard. Raises DeviceFault if a device failed and this
        process cannot use it any more.
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
        `rule.step`. Of a patch at the frame only a part is seen: it counts as if the picture were mirrored
        there, twice for each side that it touches.
        """
        ...

    def edge_weights(self, channels: Sequence[Plane], params: GdrParams) -> Plane:
        """w, (H, W) over 0 to 1 (R4), from 1 to 3 planes of levels, 0 to 255: the steepest counts."""
        ...

    def glints(self, channels: Sequence[Plane], rule: GlintRule) -> tuple[Mask, Mask]:
        """Pixels (H, W) that are bright and colourless, and those that are over `rule.nearly`."""
        ...

    def fill_occlusions(self, u: Plane, known: Mask, rule: OcclusionRule) -> tuple[Plane, Mask]:
        """Give each occlusion among the unknown pixels the value on its left; and which those are (R2)."""
        ...

    def reach(self, seeds: Mask, passing: Mask, soft: Mask, u: Plane, step: float) -> Mask:
        """What can be walked to from `seeds`: along rows right and left, then columns down and up (R10).

        A step leads onto a `passing` pixel, and changes `u` by at most `step` px or touches a `soft` pixel.
        """
        ...

    def poll(self, rivals: Rivals, matte: Mask, spoilt: Mask, rule: PollRule) -> Polls:
        """Let the pixels that can be checked vote on the upload (R8, R9); plane sums for R7.

        `matte`: no glint; `spoilt`: beside what a map hides, or a glint, where evidence cannot be compared.
        """
        ...

    def ground(self, polls: Polls, size: Size, rule: GroundRule) -> Ground:
        """What the votes say at each pixel of a picture of `size` (R8, R9)."""
        ...

    def bend(self, u: Plane, polls: Polls, rule: BendRule) -> Plane:
        """`u` (H, W), bent towards the plane around it where its match lies left of the right image (R7)."""
        ...

    def choose(self, rivals: Rivals, grounds: Grounds, rule: ChoiceRule) -> Plane:
        """The share of the upload in the result, (H, W) in [0, 1] (R10)."""
        ...

    def merge(self, offer: Offer, upload: Plane, valid: Mask, near: float) -> Plane:
        """Put a map and the upload, px of the input, together at input size, (H, W) px, at least 0 (R9).

        Where the upload is valid, both are blended by the share if they differ by less than `near` px. Else
        the upload stays where it is chosen and fits: within 1 px of the range of the chosen samples in the
        3 x 3 around the one that the pixel's centre falls on. What does not fit was never judged, and takes
        that sample if it is chosen.
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

    def shown(self, sparse: Sparse) -> tuple[Mask, Mask]:
        """Pixels (H, W) of a map that are seen in the right image; those that are not, or hardly.

        Hardly: the map, 0 px where it is not valid, rises so steeply, by 2 px over 4, that the right image
        has half as many pixels for it. Both are of valid pixels, the latter of those 2 px left of it.
        """
        ...

    def tell(self, u: Plane, origins: Origins) -> tuple[npt.NDArray[np.uint8], list[int]]:
        """Values of `Provenance` for a map at input size, (H, W) px, and how many pixels have each.

        Whether a pixel is kept is said by the one of the working size that its centre falls on.
        """
        ...
