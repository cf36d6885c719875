"""What the steps of a backend are given, and what they give. All planes are (H, W)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Mask
from stereomend.refinement.stage_params import FusionParams

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


class Sparse(NamedTuple):
    """A disparity map (H, W) in pixels of its own size, 0 where `valid` (H, W) is false."""

    u: Plane
    valid: Mask


class Origins(NamedTuple):
    """What a map at input size came from."""

    initial: Sparse
    kept: Mask
    """At working size: nothing replaced the value."""
    scene: Mask | None = None
    """At input size: part of the scene; None: all is."""
    within: float = 0.5
    """A pixel moved by no more than this, in pixels, counts as kept."""


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
    least: float = 0.5
    """And its evidence is over this: a map that the pair contradicts replaces nothing."""
    apart: float = 0.5
    """And the two differ by more than this, px; nearer readings compete in the solver itself."""


class GlintRule(NamedTuple):
    """What is bright and colourless, by the largest and smallest level of a pixel (R1)."""

    saturation: float
    """They differ by less than this share of the largest."""
    bright: float
    """The largest is over this, grey levels."""
    rise: float
    """A glint rises by more than this above what surrounds it, grey levels."""

    @property
    def nearly(self) -> float:
        """What is darker cannot hide a glint: the level that has to surround it, and one of room."""
        return self.bright - self.rise - 1


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
    lack: float
    """Evidence that the upload lacks where a vote against it counts in full."""
    most: float
    """The lead of a pixel's evidence that counts at most, either way."""
    clear: tuple[float, float] = (0.3, 0.7)
    """Evidence for GDR's map that lets a pixel vote, and lets it vote in full."""
    frame: float = 3.0
    """Votes have their match farther inside of the right image's left end, px: descriptors see around."""

    @classmethod
    def of(cls, params: FusionParams, scale: float) -> PollRule:
        """For maps at `scale` of the input's size."""
        lengths = params.tolerance_px * scale, params.near_px * scale
        return cls(*lengths, params.against_by, params.most_lead)


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
    """What the upload hides or shows at a grazing angle, and beside it; not where it is seen through."""


_ROUNDED = 1.01
"""Of a difference, as that of values that were rounded."""


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
    def of(cls, params: FusionParams, scale: float, pixels: int, grain_px: float = 0.0) -> ChoiceRule:
        """For so many pixels at `scale` of the input's size, and an upload that is in steps of the grain."""
        return cls(
            near=params.near_px * scale,
            enough=1 - (params.max_doubt + params.low_doubt) / 2,
            full_trust=1 - params.low_doubt,
            high_trust=1 - params.trusted_doubt,
            win_margin=params.win_margin,
            trusted_margin=params.trusted_margin,
            weak_share=params.weak_share,
            spike=params.spike_px,
            rough_share=params.rough_share,
            step=max(params.step_px, _ROUNDED * grain_px) * scale,
            soft_edge=params.soft_edge,
            largest_patch=int(params.patch_share * pixels),
        )


CELL = 8
"""Pixels per cell of the grid that wide means are computed on, along both axes."""


class Polls(NamedTuple):
    """Means over cells of `CELL` x `CELL` pixels, float64; a cell at the end has fewer."""

    voted: Cells
    """Votes against the upload count as far as the pair tells both maps apart."""
    agreed: Cells
    """Of the votes."""
    fair: Cells
    """Votes where both say nearly the same, and nothing spoils the comparison."""
    lead: Cells
    """Their sum of the evidence for the upload beyond that for GDR's map, which one pixel cannot decide."""
    level: Cells
    """Their sum of the evidence for GDR's map."""
    shown: Cells
    """The share of GDR's map that the right image shows."""
    of_u: Cells
    """Sums of u over that, px."""
    of_square: Cells
    """And of u * u."""


class GroundRule(NamedTuple):
    """How votes become trust, and what is compared a verdict (R8, R9); widths in px at working size."""

    trust: float
    """Standard deviation of the window of trust."""
    evidence: float
    """And of that which evidence is compared in."""
    far_share: float
    """Weight of a faint window `far` times as wide, which carries trust over gaps."""
    min_trust: float
    full_trust: float
    worse_by: float
    equal_within: float
    far: float = 4.0

    @classmethod
    def of(cls, params: FusionParams, width: int) -> GroundRule:
        """For a picture of so many columns; windows have a least width, for few votes say nothing."""
        trust, evidence = (
            max(share * width, params.least_width_px) for share in (params.trust_width, params.evidence_width)
        )
        trusts = 1 - params.max_doubt, 1 - params.low_doubt
        return cls(trust, evidence, params.far_share, *trusts, params.worse_by, params.equal_within)


class Ground(NamedTuple):
    """What the votes say, each (H, W)."""

    level: Plane
    """Trust T, 0 to 1 (R8)."""
    equal: Plane
    """0 to 1: where both say nearly the same, the upload is as good as GDR's map (R9)."""
    usual: Plane
    """Evidence for GDR's map where both agree."""


class BendRule(NamedTuple):
    """How a map is continued where its match lies outside of the right image (R7)."""

    window: float
    """Standard deviation of the window that a plane is fitted in, px."""
    bend: float
    """The largest change, as a share of the disparity."""
    flat: float
    """Residual of the plane from which half of the change is left, px."""


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


COPIES = ("h2d", "d2h")
"""What is timed on a device besides the solve: the copies to it and back."""


class Solved(NamedTuple):
    """What GDR makes of a problem, and how."""

    u: Plane
    """(H, W) px."""
    by: str
    """The name of the backend that computed it: one may leave a problem to another."""
    copies: Mapping[str, float] = MappingProxyType({})
    """Milliseconds of each of `COPIES`, where a device computed it."""
    warnings: tuple[str, ...] = ()
    """For `quality.warnings`."""
    device: str | None = None
    """The name of the device that computed it; None: the CPU."""
