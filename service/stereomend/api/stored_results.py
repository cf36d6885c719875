"""Results of jobs as answers."""

from __future__ import annotations

import asyncio

from starlette.requests import Request
from starlette.responses import Response

from stereomend.api.conditional import etag_of, has_already, not_modified
from stereomend.api.job_documents import offered_for
from stereomend.api.negotiation import choose
from stereomend.api.results import result_response
from stereomend.codec import render
from stereomend.jobs.records import JobRecord, JobState
from stereomend.jobs.service import JobService, StoredResult
from stereomend.jobs.task import Answer


async def stored_result(jobs: JobService, record: JobRecord, request: Request) -> Response:
    """Answer with a job's result in the media type that `Accept` asks for, or with 304.

    Raises:
        NotAcceptable: it is not offered; a point cloud is only where there is a calibration.
        JobNotFinished, JobFailed, JobCancelled, ResultExpired: there is no result.
        DisparityOutOfRange: it does not fit the media type.
    """
    media_type = choose(", ".join(request.headers.getlist("accept")), offered_for(record.params))
    headers = {"ETag": etag_of(record.result_sha256, media_type), "Vary": "Accept"}
    if record.state is JobState.SUCCEEDED and has_already(request, headers["ETag"]):
        return not_modified(headers)
    stored = await jobs.result(record.id, record.owner)
    return result_response(await asyncio.to_thread(_answer, stored, media_type), headers)


def _answer(stored: StoredResult, media_type: str) -> Answer:
    record = stored.record
    body = render(stored.content, media_type, record.params.get("outputs"))
    return Answer(body, media_type, record.meta or {}, dict(record.timings_ms))
