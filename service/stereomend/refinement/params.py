"""The parameters of a refinement: presets, ranges, units and the equations they stand in.

Equation numbers are those of Yang, Simon, Linte, J. Med. Imaging 10(4), 045001, 2023,
doi:10.1117/1.JMI.10.4.045001.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from stereomend.disparity import Calibration
from stereomend.errors import InvalidParameter

Stage = Literal["ldr", "gdr"]
Initial = Literal["upload", "sgbm", "zero"]
Output = Literal["disparity", "confidence", "provenance", "input_confidence", "depth_mm"]

DEFAULT_PRESET = "paper"
LEVELS_FROM_ZERO = 6


class _Params(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class LdrParams(_Params):
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
    specular: Literal["saturation", "bright", "off"] = Field(
        "saturation",
        description="what is a highlight: low saturation (Eq. 3), low saturation and high value, or nothing",
    )

    @field_validator("window")
    @classmethod
    def _odd(cls, window: int) -> int:
        if window % 2 == 0:
            raise ValueError(f"expected an odd number, got {window}")
        return window


class GdrParams(_Params):
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
    levels: int = Field(4, ge=1, le=16, description="levels of the pyramid; small images get fewer [1]")
    warps: int = Field(50, ge=1, le=1000, description="linearisations per level [1]")
    iterations: int = Field(5, ge=1, le=1000, description="primal-dual iterations per warp [1]")
    descriptor: Literal["signed", "absolute"] = Field(
        "signed", description="differences to the 3 x 3 neighbours, signed or, as printed, absolute (Eq. 10)"
    )
    tau: float = Field(0.25, gt=0, le=10, description="primal step [1]; 8 tau sigma <= 1")
    sigma: float = Field(0.5, gt=0, le=10, description="dual step [1]; 8 tau sigma <= 1")

    @model_validator(mode="after")
    def _converges(self) -> Self:
        if 8 * self.tau * self.sigma > 1 + 1e-9:
            raise ValueError(f"expected 8 * tau * sigma <= 1, got {8 * self.tau * self.sigma:g}")
        return self


class Preset(NamedTuple):
    """A named set of parameters."""

    description: str
    ldr: LdrParams
    gdr: GdrParams


PRESETS: Mapping[str, Preset] = MappingProxyType(
    {
        "paper": Preset(
            "The method as printed, with signed descriptors.",
            LdrParams(),
            GdrParams(),
        ),
        "released": Preset(
            "The constants of the authors' published program: fewer warps, no photometric test.",
            LdrParams(photometric_weight=0.0, smoothness_power=2),
            GdrParams(data_weight=0.375, warps=5, iterations=30),
        ),
    }
)


class RefineParams(_Params):
    """Everything that one refinement is told besides its images. Build it with `parse_params`."""

    preset: str = Field(DEFAULT_PRESET, description="the set of parameters to start from")
    stages: tuple[Stage, ...] = Field(("ldr", "gdr"), min_length=1, description="the stages to run")
    initial: Initial | None = Field(
        None, description="what starts the method; default: the upload, or sgbm when none is uploaded"
    )
    processing_scale: float = Field(0.5, ge=0.05, le=1, description="working size divided by input size [1]")
    disparity_scale: float | None = Field(
        None,
        gt=0,
        description="divisor of integer disparity maps [1/px]; default 256 for 16-bit PNG, else required",
    )
    outputs: tuple[Output, ...] | None = Field(
        None, min_length=1, description="the arrays of a zip result; default: all, depth_mm if calibrated"
    )
    focal_px: float | None = Field(
        None, gt=0, le=1e6, description="f, focal length of the images as sent [px]; needs baseline_mm"
    )
    baseline_mm: float | None = Field(
        None,
        gt=0,
        le=1e6,
        description="B, distance of the cameras [mm]; needs focal_px; Z = f B / (d + doffs)",
    )
    cx: float | None = Field(
        None, ge=-1e6, le=1e6, description="principal point's column [px]; default (width - 1) / 2"
    )
    cy: float | None = Field(
        None, ge=-1e6, le=1e6, description="principal point's row [px]; default (height - 1) / 2"
    )
    doffs: float = Field(
        0.0, ge=-1e6, le=1e6, description="cx of the right image minus cx of the left one [px]"
    )
    ldr: LdrParams = Field(default_factory=LdrParams, description="overrides of the preset's local stage")
    gdr: GdrParams = Field(default_factory=GdrParams, description="overrides of the preset's global stage")

    @model_validator(mode="after")
    def _calibrated_or_not(self) -> Self:
        missing = [name for name in ("focal_px", "baseline_mm") if getattr(self, name) is None]
        if len(missing) == 1:
            raise ValueError(f"{missing[0]} is missing: focal_px and baseline_mm go together")
        if missing and "depth_mm" in (self.outputs or ()):
            raise ValueError("outputs: depth_mm needs focal_px and baseline_mm")
        return self

    @property
    def calibrated(self) -> bool:
        """Whether depth can be computed."""
        return self.focal_px is not None

    def calibration(self, size: tuple[int, int]) -> Calibration | None:
        """What turns disparity into depth for images of `size` (height, width); None if not calibrated."""
        if self.focal_px is None or self.baseline_mm is None:
            return None
        cx = (size[1] - 1) / 2 if self.cx is None else self.cx
        cy = (size[0] - 1) / 2 if self.cy is None else self.cy
        return Calibration(self.focal_px, self.baseline_mm, cx, cy, self.doffs)


def parse_params(given: Mapping[str, Any] | None = None) -> RefineParams:
    """Check parameters as a client sends them and complete them from their preset.

    `initial="zero"` starts from 6 levels (the paper's ablation) unless `gdr.levels` is given.

    Raises:
        InvalidParameter: a name is unknown, a value out of range; the message names all of them.
    """
    given = dict(given or {})
    preset = _preset(given.get("preset", DEFAULT_PRESET))
    local, globally = _overrides(given, "ldr"), _overrides(given, "gdr")
    if given.get("initial") == "zero":
        globally = {"levels": LEVELS_FROM_ZERO} | globally
    given["ldr"] = preset.ldr.model_dump() | local
    given["gdr"] = preset.gdr.model_dump() | globally
    try:
        return RefineParams.model_validate(given)
    except ValidationError as error:
        raise InvalidParameter("; ".join(map(_sentence, error.errors()))) from error


def _preset(name: object) -> Preset:
    if not isinstance(name, str) or name not in PRESETS:
        raise InvalidParameter(f"preset: got {name!r}, expected one of {', '.join(PRESETS)}")
    return PRESETS[name]


def _overrides(given: Mapping[str, Any], stage: Stage) -> dict[str, Any]:
    overrides = given.get(stage, {})
    if not isinstance(overrides, Mapping):
        raise InvalidParameter(f"{stage}: got {overrides!r}, expected an object of parameters")
    return dict(overrides)


def _sentence(error: Mapping[str, Any]) -> str:
    where = ".".join(map(str, error["loc"])) or "params"
    if error["type"] == "extra_forbidden":
        return f"{where}: unknown parameter"
    if error["type"] == "value_error":
        return f"{where}: {error['ctx']['error']}"
    return f"{where}: {error['msg']}, got {error['input']!r}"
