"""What each stage can be told: ranges, units and the equations the parameters stand in.

Equation numbers are those of Yang, Simon, Linte, J. Med. Imaging 10(4), 045001, 2023,
doi:10.1117/1.JMI.10.4.045001; R numbers those of `docs/robust.md`. Lengths that belong to the picture are
shares of its width, so that they hold for every size; those that belong to matching are pixels.
"""

from __future__ import annotations

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator


class StageParams(BaseModel):
    """Frozen, and strict about names and finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class LdrParams(StageParams):
    """Local disparity refinement, Eq. 1 to 5."""

    window: int = Field(
        21,
        ge=3,
        le=201,
        description="side of the square window of the local mean, odd [px at working size] (Eq. 1)",
    )
    smoothness_weight: float = Field(
        20.0, ge=0, le=1000, description="alpha_s, falloff of smoothness [1] (Eq. 1)"
    )
    smoothness_power: int = Field(
        1,
        ge=1,
        le=4,
        description="exponent of C_s in C_f [1]: 1 as printed (Eq. 4), 2 in the authors' program",
    )
    photometric_weight: float = Field(
        2.0,
        ge=0,
        le=1000,
        description="alpha_p, falloff of photometric consistency [1], 0 leaves it out (Eq. 2)",
    )
    min_saturation: float = Field(
        0.1,
        ge=0,
        le=1,
        description="th_s, HSV saturation at or below which a pixel may be a highlight [1] (Eq. 3)",
    )
    min_confidence: float = Field(
        0.5, ge=0, le=1, description="th_f, confidence below which a pixel is an outlier [1] (Eq. 5)"
    )
    search_px: float = Field(
        40.0, ge=1, le=10000, description="steps taken in each of the eight directions [px at input size]"
    )
    passes: int = Field(5, ge=1, le=100, description="repetitions of the search while holes remain [1]")
    specular: Literal["saturation", "bright", "glint", "off"] = Field(
        "saturation",
        description="what is a highlight: low saturation (Eq. 3), low saturation and high value, "
        "that and small, or nothing",
    )
    method: Literal["smoothness", "evidence"] = Field(
        "smoothness",
        description="what confidence is made of: Eq. 1 to 4, or how well the pair agrees (R1)",
    )
    least_evidence: float = Field(
        0.2, ge=-1, le=1, description="n at which confidence starts [1]; method evidence (R1)"
    )
    full_evidence: float = Field(
        0.7, ge=-1, le=1, description="n from which on evidence is full [1]; method evidence (R1)"
    )
    speckle_share: float = Field(
        0.0007,
        ge=0,
        le=1,
        description="smooth patches below this share of the picture are speckles [1]; method evidence (R1)",
    )
    occlusion_stretch: float = Field(
        1.6,
        ge=0,
        le=10,
        description="longest occlusion, in jumps of disparity [1]; method evidence (R2)",
    )
    occlusion_slack: float = Field(
        6.0, ge=0, le=1000, description="and so much longer [px at working size]; method evidence (R2)"
    )

    @field_validator("window")
    @classmethod
    def _odd(cls, window: int) -> int:
        if window % 2 == 0:
            raise ValueError(f"expected an odd number, got {window}")
        return window


class GdrParams(StageParams):
    """Global disparity refinement, Eq. 9 to 14, and its primal-dual solver (Chambolle and Pock 2011)."""

    data_weight: float = Field(
        0.5,
        ge=0,
        le=1000,
        description="lambda, weight of the descriptors' distance, summed over 8 [1] (Eq. 9)",
    )
    huber_epsilon: float = Field(
        0.1,
        ge=0,
        le=100,
        description="epsilon, gradient where |.|_eps turns from square to norm [px/px] (Eq. 12)",
    )
    levels: int = Field(4, ge=1, le=16, description="most levels of the pyramid [1]")
    least_side_px: int = Field(
        8, ge=1, le=10000, description="no level but the finest has a shorter side [px of the level]"
    )
    warps: int = Field(50, ge=1, le=1000, description="linearisations per level [1]")
    iterations: int = Field(5, ge=1, le=1000, description="primal-dual iterations per warp [1]")
    descriptor: Literal["signed", "absolute"] = Field(
        "signed", description="differences to the 3 x 3 neighbours, signed or, as printed, absolute (Eq. 10)"
    )
    coarse_warps: int = Field(
        0, ge=0, le=1000, description="linearisations on all levels but the finest [1]; 0: as many as there"
    )
    coarse_iterations: int = Field(
        0, ge=0, le=1000, description="iterations per warp on those levels [1]; 0: as many as on the finest"
    )
    averaging_px: float = Field(
        0.0,
        ge=0,
        le=4,
        description="standard deviation of the window that the linearised data term is averaged over "
        "[px of the level]; 0: none (R5)",
    )
    observed_only: bool = Field(
        False, description="no data term where the right image does not show the pixel (R5)"
    )
    edge_level: float | None = Field(
        None,
        gt=0,
        le=1000,
        description="colour difference where smoothness weighs 1/e; none: 1 everywhere [grey levels] (R4)",
    )
    edge_power: float = Field(1.0, gt=0, le=4, description="exponent of the colour difference [1] (R4)")
    edge_floor: float = Field(0.03, gt=0, le=1, description="least weight of the smoothness [1] (R4)")
    prior_weight: float = Field(
        0.0, ge=0, le=100, description="weight of |u - prior| where confidence is 1 [lambda] (R3)"
    )
    fill_weight: float = Field(
        0.0, ge=0, le=100, description="weight of |u - prior| in filled occlusions [lambda] (R3)"
    )
    reuse_margin: float | None = Field(
        None,
        ge=0,
        le=2,
        description="how much more evidence the prior needs to replace what a coarser level found [1]; "
        "null: it never does (R6)",
    )
    tau: float = Field(0.25, gt=0, le=10, description="primal step [1]; 8 tau sigma <= 1")
    sigma: float = Field(0.5, gt=0, le=10, description="dual step [1]; 8 tau sigma <= 1")

    @model_validator(mode="after")
    def _converges(self) -> Self:
        if 8 * self.tau * self.sigma > 1 + 1e-9:
            raise ValueError(f"expected 8 * tau * sigma <= 1, got {8 * self.tau * self.sigma:g}")
        return self


class FusionParams(StageParams):
    """The choice between the upload and what GDR found (R7 to R10)."""

    enabled: bool = Field(False, description="choose pixel by pixel; else GDR's map is the result")
    tolerance_px: float = Field(
        1.3, gt=0, le=100, description="difference at which upload and GDR disagree [px at input size] (R8)"
    )
    trust_width: float = Field(
        0.055, gt=0, le=1, description="window that trust is averaged over [share of the width] (R8)"
    )
    evidence_width: float = Field(
        0.045, gt=0, le=1, description="window that evidence is compared over [share of the width] (R9)"
    )
    least_width_px: float = Field(
        15.0, ge=0, le=1000, description="neither window is narrower [px at working size] (R8, R9)"
    )
    far_share: float = Field(
        0.1, ge=0, le=1, description="weight of a window four times as wide, or of all [1] (R8, R9)"
    )
    against_by: float = Field(
        0.05, ge=0, le=2, description="evidence that it lacks where a vote against it counts in full [1] (R8)"
    )
    max_doubt: float = Field(
        0.25,
        ge=0,
        le=1,
        description="votes against the upload, of all, from which it does not count [1] (R8)",
    )
    low_doubt: float = Field(
        0.18, ge=0, le=1, description="votes against it, of all, up to which it counts in full [1] (R8)"
    )
    trusted_doubt: float = Field(
        0.15,
        ge=0,
        le=1,
        description="votes against it, of all, up to which it may lack evidence, and hide what GDR sees [1] "
        "(R10)",
    )
    worse_by: float = Field(
        0.008, ge=0, le=1, description="share of evidence that the upload lacks and loses by [1] (R9)"
    )
    most_lead: float = Field(
        0.02, gt=0, le=2, description="lead of a pixel's evidence that counts at most, either way [1] (R9)"
    )
    equal_within: float = Field(
        0.002, ge=0, le=1, description="share of evidence that it may lack and win [1] (R9)"
    )
    win_margin: float = Field(
        0.02, ge=0, le=2, description="evidence that it needs beyond GDR's where they differ [1] (R10)"
    )
    trusted_margin: float = Field(
        0.18, ge=0, le=2, description="evidence that it may lack there where trust is high [1] (R10)"
    )
    near_px: float = Field(
        1.5, gt=0, le=100, description="up to here the two are blended [px at input size] (R10)"
    )
    weak_share: float = Field(
        0.8,
        ge=0,
        le=1,
        description="GDR sees nothing below this share of the evidence around [1] (R10)",
    )
    spike_px: float = Field(
        0.16,
        gt=0,
        le=100,
        description="rise above both neighbours, as of no surface [px at working size] (R10)",
    )
    rough_share: float = Field(
        0.04, ge=0, le=1, description="share of spikes and holes around that makes it rough [1] (R10)"
    )
    step_px: float = Field(
        1.2, gt=0, le=100, description="steps of a smooth surface [px at input size] (R10)"
    )
    soft_edge: float = Field(
        0.75, ge=0, le=1, description="smoothness weight below which the surface may jump [1] (R10)"
    )
    patch_share: float = Field(
        0.003,
        ge=0,
        le=1,
        description="patches of the upload up to this size are dropped [share of the picture] (R10)",
    )
    least_believed: float = Field(
        0.25,
        ge=0,
        le=1,
        description="share of what lies beyond the frame, below which none of it is believed [1] (R10)",
    )
    reach: float = Field(
        0.8, gt=0, le=10, description="window of the plane fit, in large disparities [1] (R7)"
    )
    flat_px: float = Field(
        1.0, gt=0, le=100, description="residual at which a plane counts half [px at working size] (R7)"
    )
    bend: float = Field(0.1, ge=0, le=1, description="largest change by the plane, in disparities [1] (R7)")
