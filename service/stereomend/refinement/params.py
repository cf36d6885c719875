"""The parameters of a refinement, and the presets they start from."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, Self

from pydantic import Field, ValidationError, model_validator

from stereomend.disparity import Calibration
from stereomend.errors import InvalidParameter
from stereomend.refinement.stage_params import FusionParams, GdrParams, LdrParams, StageParams

Stage = Literal["ldr", "gdr"]
Initial = Literal["upload", "sgbm", "zero"]
Output = Literal["disparity", "confidence", "provenance", "input_confidence", "depth_mm"]

DEFAULT_PRESET = "robust"
LEVELS_FROM_ZERO = 6


class Preset(NamedTuple):
    """A named set of parameters."""

    description: str
    ldr: LdrParams
    gdr: GdrParams
    fusion: FusionParams = FusionParams()
    processing_scale: float = 0.5


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
        "robust": Preset(
            "Colour edges, an averaged data term, and the upload wherever it is as good as what GDR finds.",
            LdrParams(method="evidence", specular="glint", min_confidence=0.3),
            GdrParams(
                data_weight=1.0,
                levels=16,
                warps=1,
                iterations=20,
                coarse_warps=8,
                coarse_iterations=8,
                averaging_px=3.5,
                observed_only=True,
                edge_level=20.0,
                edge_power=1.5,
                prior_weight=0.07,
                fill_weight=0.17,
                reuse_margin=0.25,
                tau=0.4,
                sigma=0.3125,
            ),
            FusionParams(enabled=True),
            processing_scale=0.75,
        ),
    }
)


class RefineParams(StageParams):
    """Everything that one refinement is told besides its images. Build it with `parse_params`."""

    preset: str = Field(DEFAULT_PRESET, description="the set of parameters to start from")
    stages: tuple[Stage, ...] = Field(("ldr", "gdr"), min_length=1, description="the stages to run")
    initial: Initial | None = Field(
        None, description="what starts the method; default: the upload, or sgbm when none is uploaded"
    )
    processing_scale: float = Field(
        0.5, ge=0.05, le=1, description="working size divided by input size [1]; default: the preset's"
    )
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
    fusion: FusionParams = Field(
        default_factory=FusionParams, description="overrides of the preset's choice between upload and GDR"
    )

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

    `initial="zero"` starts from 6 levels or more (the paper's ablation) unless `gdr.levels` is given.

    Raises:
        InvalidParameter: a name is unknown, a value out of range; the message names all of them.
    """
    given = dict(given or {})
    preset = _preset(given.get("preset", DEFAULT_PRESET))
    local, globally, fusion = (_overrides(given, group) for group in ("ldr", "gdr", "fusion"))
    if given.get("initial") == "zero":
        globally = {"levels": max(LEVELS_FROM_ZERO, preset.gdr.levels)} | globally
    given["ldr"] = preset.ldr.model_dump() | local
    given["gdr"] = preset.gdr.model_dump() | globally
    given["fusion"] = preset.fusion.model_dump() | fusion
    given.setdefault("processing_scale", preset.processing_scale)
    try:
        return RefineParams.model_validate(given)
    except ValidationError as error:
        raise InvalidParameter("; ".join(map(_sentence, error.errors()))) from error


def _preset(name: object) -> Preset:
    if not isinstance(name, str) or name not in PRESETS:
        raise InvalidParameter(f"preset: got {name!r}, expected one of {', '.join(PRESETS)}")
    return PRESETS[name]


def _overrides(given: Mapping[str, Any], group: str) -> dict[str, Any]:
    overrides = given.get(group, {})
    if not isinstance(overrides, Mapping):
        raise InvalidParameter(f"{group}: got {overrides!r}, expected an object of parameters")
    return dict(overrides)


def _sentence(error: Mapping[str, Any]) -> str:
    where = ".".join(map(str, error["loc"])) or "params"
    if error["type"] == "extra_forbidden":
        return f"{where}: unknown parameter"
    if error["type"] == "value_error":
        return f"{where}: {error['ctx']['error']}"
    return f"{where}: {error['msg']}, got {error['input']!r}"
