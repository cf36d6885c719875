"""GET /v1/presets: what a refinement can be told."""

from __future__ import annotations

from fastapi import APIRouter

from stereomend.api.job_options import params_schema
from stereomend.api.openapi import problems
from stereomend.api.schemas import PresetDescription, PresetsAnswer
from stereomend.refinement import DEFAULT_PRESET, PRESETS

router = APIRouter(tags=["refine"])


@router.get("/v1/presets", summary="Presets, and the schema of parameters", responses=problems(401, 403))
async def presets() -> PresetsAnswer:
    """List the presets, the default one, and the JSON Schema of the part `params`."""
    described = {
        name: PresetDescription(
            description=preset.description,
            params={"ldr": preset.ldr.model_dump(), "gdr": preset.gdr.model_dump()},
        )
        for name, preset in PRESETS.items()
    }
    return PresetsAnswer(default=DEFAULT_PRESET, presets=described, parameters=params_schema())
