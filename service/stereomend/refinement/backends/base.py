"""What a backend does. All planes are (H, W); images are grey levels from 0 to 255, disparities pixels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Image, Mask
from stereomend.refinement.stage_params import FusionParams, GdrParams, LdrParams

Plane = npt.NDArray[np.floating[Any]]
"""float32 (H, W) for `native`, float64 for `reference`."""

Cells = npt.NDArray[np.float64]
"""A number for each cell of a coarse grid."""

HALF = 0.5 - 1e-6
"""A share from here on is half or more; one half survives rounding."""

SMALLEST = 0.5
"""A smaller disparity [px] is a network's way to say that it knows nothing."""

Size = tuple[int, int]
"""Height and width in pixels."""


Tick = Callable[[], None]
"""Called before each warp of a solve, in the caller's thread; what it raises ends the solve."""


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


class Rivals(NamedTuple):
    """The upload and GDR's map at working size, and what the pair says of them, each (H, W)."""

    upload: Plane
    """Samples, px; 0 where unknown."""
    valid: Mask
    """The upload is known."""
    u: Plane
    """GDR's map, px."""
    for_upload: Plane
    """Evidence n."""
    for_u: Plane
    upload_shown: Mask
    """Valid, and shown by the right image if the upload is right."""
    u_shown: Mask


class PollRule(NamedTuple):
    """Who votes on the upload, and how (R8, R9)."""

    tolerance: float
    """Difference at which both maps disagree, px at working size."""
    near: float
    """Difference up to which they say nearly the same, px at working size."""
    clear: tuple[float, float] = (0.3, 0.7)
    """Evidence for GDR's map that lets a pixel vote, and lets it vote in full."""
    frame: float = 3.0
    """Votes have their match farther inside of the right image's left end, px: descriptors see around."""


class Grounds(NamedTuple):
    """What the choice is made on, besides the maps, each (H, W)."""

    level: Plane
    """Trust T, 0 to 1 (R8)."""
    equal: Plane
    """0 to 1: where both say nearly the same, the upload is as good as GDR's map (R9)."""
    usual: Plane
    """Evidence for GDR's map where both agree."""
    edge: Plane
    """Weight of the smoothness, over 0 to 1."""
    glints: Mask
    """A glint, or beside one."""
    beside: Mask
    """The upload hides it, or something beside it."""


class ChoiceRule(NamedTuple):
    """The constants of R10; lengths in px at working size."""

    near: float
    enough: float
    full_trust: float
    high_trust: float
    win_margin: float
    trusted_margin: float
    weak_share: float
    spike: float
    rough_share: float
    step: float
    soft_edge: float
    largest_patch: int
    """The most pixels of a patch that is dropped."""

    @classmethod
    def of(cls, params: FusionParams, scale: float, pixels: int) -> ChoiceRule:
        """For a picture of so many pixels at `scale` of the input's size."""
        return cls(
            near=params.near_px * scale,
            enough=(params.min_trust + params.full_trust) / 2,
            full_trust=params.full_trust,
            high_trust=params.high_trust,
            win_margin=params.win_margin,
            trusted_margin=params.trusted_margin,
            weak_share=params.weak_share,
            spike=params.spike_px,
            rough_share=params.rough_share,
            step=params.step_px,
            soft_edge=params.soft_edge,
            largest_patch=int(params.patch_share * pixels),
        )


CELL = 8
"""Pixels per cell of the grid that wide means are computed on, along both axes."""


class Polls(NamedTuple):
    """Means over cells of `CELL` x `CELL` pixels, float64; a cell at the end has fewer."""

    voted: Cells
    agreed: Cells
    """Of the votes."""
    fair: Cells
    """Votes where both say nearly the same, and nothing spoils the comparison."""
    lead: Cells
    """Their sum of the evidence for the upload beyond that for GDR's map."""
    level: Cells
    """Their sum of the evidence for GDR's map."""
    shown: Cells
    """The share of GDR's map that the right image shows."""
    of_u: Cells
    """Sums of u over that, px."""
    of_square: Cells
    """And of u * u."""


class Offer(NamedTuple):
    """A map and samples of the upload, px, for `Backend.merge` to choose from, each (H, W)."""

    u: Plane
    share: Plane
    """Of the upload, 0 to 1; over a half, it is chosen."""
    sample: Plane


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

    def shrink(self, image: Plane | Mask, size: Size) -> Plane:
        """Shrink to `size` by the area mean."""
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

    def globally(self, problem: Problem, params: GdrParams, tick: Tick | None = None) -> Plane:
        """All of GDR from coarse to fine (Eq. 9 to 14, R3 to R6), (H, W) px.

        What the levels make of each other is said in `coarse_to_fine`, which backends without a memory of
        their own share; on a device no `tick` is heard.
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

    def poll(self, rivals: Rivals, matte: Mask, spoilt: Mask, rule: PollRule) -> Polls:
        """Let the pixels that can be checked vote on the upload (R8, R9); plane sums for R7.

        `matte`: no glint; `spoilt`: beside what a map hides, or a glint, where evidence cannot be compared.
        """
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
