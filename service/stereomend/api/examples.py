"""Examples of the documents, made by the code that makes the real ones."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

from fastapi.sse import format_sse_event

from stereomend import errors
from stereomend.api.job_documents import JobsDocument, job_document
from stereomend.api.problems import problem_document, status_of
from stereomend.errors import StereomendError
from stereomend.jobs.records import JobRecord, JobState, Progress
from stereomend.jobs.task import TIMINGS

_ACCEPTED = datetime(2026, 3, 2, 9, 30, tzinfo=UTC)
_ID = "0f8fad5bd9cb469fa16570867728950e"
_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"

PARAMS: dict[str, Any] = {"preset": "paper", "stages": ["ldr", "gdr"], "gdr": {"warps": 10}}

_RUNNING: dict[str, Any] = {
    "id": _ID,
    "owner": "local",
    "preset": "paper",
    "params": PARAMS,
    "input": {"width": 720, "height": 576, "sha256": _SHA256},
    "priority": 0,
    "attempt": 1,
    "cancel_requested": False,
    "keep_inputs": False,
    "request_id": "frame-17",
    "created_at": _ACCEPTED,
    "started_at": _ACCEPTED + timedelta(seconds=1),
}
_DONE: dict[str, Any] = {
    "finished_at": _ACCEPTED + timedelta(seconds=2),
    "expires_at": _ACCEPTED + timedelta(seconds=3602),
    "backend": "native",
    "device": "cpu",
    "timings_ms": dict(zip(TIMINGS, (1000.0, 9.1, 2.3, 0.0, 2.0, 36.2, 8.1, 0.4, 1058.4), strict=True)),
    "quality": {
        "valid_in": 0.98,
        "kept": 0.41,
        "refined": 0.44,
        "filled": 0.1,
        "unobserved": 0.05,
        "levels": 4,
        "residual_before": 1.02,
        "residual_after": 0.71,
        "warnings": [],
    },
    "result_sha256": _SHA256,
}

_running = JobRecord(state=JobState.RUNNING, version=4, progress=Progress("gdr", 12, 40), **_RUNNING)
_succeeded = JobRecord(
    state=JobState.SUCCEEDED, version=9, progress=Progress("encode", 1, 1), **_RUNNING | _DONE
)

RUNNING_JOB = job_document(_running).model_dump(mode="json")
JOB = job_document(_succeeded).model_dump(mode="json")
JOBS = JobsDocument(
    jobs=[job_document(_running), job_document(_succeeded)], next_cursor="MjAyNi0wMy0wMg"
).model_dump(mode="json")
EVENTS = (
    format_sse_event(retry=1000).decode()
    + format_sse_event(data_str=job_document(_running).model_dump_json(), event="progress", id="4").decode()
)

_PROBLEMS: tuple[StereomendError, ...] = (
    errors.MalformedRequest("part 'right' is missing; expected left, right and optionally disparity"),
    errors.AccessDenied("send an API key: `Authorization: Bearer <key>`"),
    errors.Forbidden("this key may not submit"),
    errors.JobNotFound(f"there is no job {_ID}"),
    errors.NotAcceptable("Accept is 'image/webp'; offered are image/png, application/x-npy"),
    errors.JobNotFinished(f"job {_ID} is running"),
    errors.ResultExpired(f"the result of job {_ID} was deleted on 2026-03-02T10:30:02Z"),
    errors.BodyTooLarge("the body is larger than the 256 MiB that the server takes"),
    errors.UnknownFormat("left: a PDF; expected an image"),
    errors.ShapeMismatch("right is 720 x 575 (width x height), left is 720 x 576; they must be equal"),
    errors.QueueFull("256 requests with 800 MiB wait or run; the server holds 256 with 4096 MiB"),
    errors.InternalError("a fault of the server's; its log has the details under this request id"),
    errors.NotReady("no worker is up: a worker is being restarted"),
    errors.DiskFull("900 MiB are free on the disk; 1024 MiB must stay free"),
)
PROBLEMS: dict[int, dict[str, Any]] = {
    status_of(type(error)): problem_document(error, "frame-17") for error in _PROBLEMS
}
"""A problem document of each status."""
