"""The JSON documents of the API."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field


class ProblemDocument(BaseModel):
    """What went wrong, RFC 9457."""

    type: str = Field(description="stable name of the kind of problem", examples=["/problems/shape-mismatch"])
    title: str = Field(description="the kind of problem, for people")
    status: int = Field(description="the HTTP status")
    detail: str = Field(description="what came and what was expected")
    request_id: str = Field(description="names the request in the server's log")


class PresetDescription(BaseModel):
    """A preset and what it stands for."""

    description: str
    params: dict[str, dict[str, Any]] = Field(description="the parameters of both stages, `ldr` and `gdr`")


class PresetsAnswer(BaseModel):
    """The presets, and the JSON Schema of all parameters."""

    default: str = Field(description="the preset of requests that name none")
    presets: dict[str, PresetDescription]
    parameters: dict[str, Any] = Field(
        serialization_alias="schema", description="JSON Schema of the part `params`"
    )


class Liveness(BaseModel):
    """The server answers."""

    status: str = Field("alive", description="`alive`")


class Readiness(BaseModel):
    """The server can refine."""

    status: str = Field("ready", description="`ready`")
    backend: str = Field(description="what computes")
    reason: str = Field(description="why this backend was taken")
    kernel: str = Field(description="hash of the kernels' sources")
    workers_up: int = Field(description="worker processes that are up")
    workers: int = Field(description="worker processes there should be")
