"""A job as the API shows it."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from pydantic import BaseModel, Field

from stereomend.api.problems import problem_document
from stereomend.api.schemas import ProblemDocument
from stereomend.codec import MEDIA_TYPES, PLY_TYPE, PREVIEW_TYPE
from stereomend.errors import error_from_slug
from stereomend.jobs.records import JobRecord, JobState

OFFERED = tuple(dict.fromkeys(("image/png", *MEDIA_TYPES.values(), PREVIEW_TYPE)))
"""The media types of a result; the first is the default."""


class ProgressDocument(BaseModel):
    """How far a running job is."""

    phase: str = Field(description="`queue`, `decode`, `initial`, `ldr`, `gdr` or `encode`")
    done: int = Field(description="steps of the phase that are done")
    total: int = Field(description="steps of the phase; 0: unknown")


class InputDocument(BaseModel):
    """What was sent."""

    width: int = Field(description="of the images [px]")
    height: int = Field(description="of the images [px]")
    sha256: str = Field(description="of the parts of the body")


class ResultDocument(BaseModel):
    """What came of it, and where it is."""

    href: str = Field(description="path of the result")
    sha256: str = Field(description="of the result as stored")
    media_types: list[str] = Field(description="what `Accept` may ask for")


class JobDocument(BaseModel):
    """A durable refinement. Times are UTC."""

    id: str
    state: JobState = Field(description="queued, running, succeeded, failed, cancelled or expired")
    version: int = Field(description="grows with every change; the `ETag` of the job")
    preset: str
    params: dict[str, Any] = Field(description="all parameters, those of the preset included")
    priority: int = Field(description="larger ones run first, among equals the oldest")
    attempt: int = Field(description="how often a worker began it")
    progress: ProgressDocument
    cancel_requested: bool = Field(description="whether a running job has been told to stop")
    keep_inputs: bool = Field(description="whether what was sent is kept as long as this record")
    created_at: datetime
    deadline: datetime | None = Field(description="fails if it has not begun by then")
    started_at: datetime | None
    finished_at: datetime | None
    expires_at: datetime | None = Field(description="when the result is deleted")
    backend: str | None = Field(description="what computed")
    device: str | None = Field(description="on which device")
    timings_ms: dict[str, float] = Field(description="milliseconds of each stage")
    quality: dict[str, Any] | None = Field(
        description="shares of valid, kept, refined, filled and unobserved pixels, residuals, warnings"
    )
    input: InputDocument
    result: ResultDocument | None
    error: ProblemDocument | None = Field(description="why it failed")
    links: dict[str, str] = Field(
        description="`self` and `events`, and what can be asked for now of `result` and `cancel`"
    )


class JobsDocument(BaseModel):
    """A page of jobs, the newest first."""

    jobs: list[JobDocument]
    next_cursor: str | None = Field(description="`cursor` of the next page; null: this is the last")


def job_document(record: JobRecord) -> JobDocument:
    """Show a job."""
    same = {name: getattr(record, name) for name in _SAME}
    return JobDocument(
        **same,
        progress=ProgressDocument(**record.progress._asdict()),
        input=InputDocument(**record.input),
        result=_result(record),
        error=_error(record),
        links=_links(record),
    )


def job_path(job_id: str) -> str:
    """The path of a job."""
    return f"/v1/jobs/{job_id}"


def offered_for(params: Mapping[str, Any]) -> tuple[str, ...]:
    """The media types of a job's result: a point cloud needs a calibration."""
    calibrated = params.get("focal_px") is not None
    return tuple(media_type for media_type in OFFERED if calibrated or media_type != PLY_TYPE)


_SAME = tuple(
    name for name in JobDocument.model_fields if name not in ("progress", "input", "result", "error", "links")
)


def _result(record: JobRecord) -> ResultDocument | None:
    if record.state is not JobState.SUCCEEDED or record.result_sha256 is None:
        return None
    href = f"{job_path(record.id)}/result"
    return ResultDocument(
        href=href, sha256=record.result_sha256, media_types=list(offered_for(record.params))
    )


def _error(record: JobRecord) -> ProblemDocument | None:
    if record.error is None:
        return None
    error = error_from_slug(record.error["slug"], record.error["detail"])
    return ProblemDocument(**problem_document(error, record.request_id))


def _links(record: JobRecord) -> dict[str, str]:
    path = job_path(record.id)
    links = {"self": path, "events": f"{path}/events"}
    if record.state is JobState.SUCCEEDED:
        links["result"] = f"{path}/result"
    if not record.state.final:
        links["cancel"] = f"{path}/cancel"
    return links
