"""What a request says of its job, beside what it says of the refinement; both come in the part `params`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from stereomend.errors import InvalidParameter
from stereomend.refinement import RefineParams


class JobOptions(BaseModel):
    """How a job is treated."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    priority: int = Field(
        0, ge=-100, le=100, description="of a job: larger ones run first, among equals the oldest"
    )
    deadline_s: float | None = Field(
        None,
        gt=0,
        le=1e7,
        description="of a job: fails if it has not begun so many seconds after it was accepted [s]",
    )
    keep_inputs: bool = Field(
        False, description="of a job: keep what was sent as long as its record; default: deleted at its end"
    )


def take_options(params: Mapping[str, Any]) -> tuple[JobOptions, dict[str, Any]]:
    """Part what `params` says of the job from what it says of the refinement.

    Raises:
        InvalidParameter: a value is of the wrong type or out of range.
    """
    options = {name: value for name, value in params.items() if name in JobOptions.model_fields}
    rest = {name: value for name, value in params.items() if name not in options}
    try:
        return JobOptions(**options), rest
    except ValidationError as error:
        raise InvalidParameter("; ".join(map(_sentence, error.errors()))) from error


def params_schema() -> dict[str, Any]:
    """JSON Schema of the part `params`: of the refinement and of its job."""
    schema = RefineParams.model_json_schema()
    schema["properties"] |= JobOptions.model_json_schema()["properties"]
    return schema


def _sentence(error: Mapping[str, Any]) -> str:
    return f"{error['loc'][0]}: {error['msg']}, got {error['input']!r}"
