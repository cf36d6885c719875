"""/v1/jobs: refinements that are accepted now and done later, whatever happens in between."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Request
from fastapi.sse import EventSourceResponse
from starlette.responses import Response

from stereomend.api import examples, openapi
from stereomend.api.conditional import asks_for_changes, has_already, not_modified
from stereomend.api.events import events_of, last_seen
from stereomend.api.job_documents import OFFERED, JobDocument, JobsDocument, job_document
from stereomend.api.job_responses import accepted_response, etag_of_job, job_response
from stereomend.api.openapi import problems
from stereomend.api.owners import Owner, Viewer
from stereomend.api.preferences import LONGEST_POLL_S, Preferences
from stereomend.api.state import ServiceOfRequest
from stereomend.api.stored_results import stored_result
from stereomend.api.submissions import read_submission
from stereomend.api.waiting import unless_gone
from stereomend.errors import JobNotFound
from stereomend.jobs.records import JobRecord, JobState, is_job_id

router = APIRouter(tags=["jobs"])

_OF_ONE = problems(401, 403, 404, 500, 503)


async def _job_id(job_id: Annotated[str, Path(description="`id` of the job")]) -> str:
    # No ledger holds another id, and some fail over odd characters.
    if not is_job_id(job_id):
        raise JobNotFound(f"there is no job {job_id!r}")
    return job_id


JobId = Annotated[str, Depends(_job_id)]


@router.post(
    "/v1/jobs",
    summary="Accept a refinement that nobody waits for",
    status_code=202,
    response_class=Response,
    responses=openapi.document(202, JobDocument, examples.RUNNING_JOB, *openapi.OF_ACCEPTED)
    | openapi.document(200, JobDocument, examples.JOB, *openapi.OF_ACCEPTED)
    | problems(400, 401, 403, 409, 413, 415, 422, 429, 500, 503, 507),
    openapi_extra=openapi.takes(openapi.IDEMPOTENCY_KEY, body=True),
)
async def submit(request: Request, service: ServiceOfRequest, owner: Owner) -> Response:
    """Answer 202 once the job is safe on the disk; 200 if its idempotency key is that of an ended one."""
    submission = await read_submission(request, service.settings, owner)
    return accepted_response(await service.jobs.submit(submission))


@router.get(
    "/v1/jobs",
    summary="List jobs",
    response_class=Response,
    responses=openapi.document(200, JobsDocument, examples.JOBS) | problems(401, 403, 422, 500, 503),
)
async def page(
    service: ServiceOfRequest,
    viewer: Viewer,
    state: Annotated[JobState | None, Query(description="only jobs in this state")] = None,
    limit: Annotated[int, Query(ge=1, le=200, description="most jobs of one page")] = 50,
    cursor: Annotated[str | None, Query(description="`next_cursor` of the page before")] = None,
) -> Response:
    """List the jobs of this key, the newest first."""
    found = await service.jobs.page(viewer, state, limit, cursor)
    shown = JobsDocument(
        jobs=[job_document(record) for record in found.records], next_cursor=found.next_cursor
    )
    return Response(shown.model_dump_json(), media_type="application/json")


@router.get(
    "/v1/jobs/{job_id}",
    summary="Look at a job, or wait until it changes",
    response_class=Response,
    responses=openapi.document(200, JobDocument, examples.JOB, "ETag", "Preference-Applied")
    | openapi.bare(304, "The client has this version of the job.", "ETag", "Preference-Applied")
    | _OF_ONE,
    openapi_extra=openapi.takes(openapi.PREFER_WAIT, openapi.IF_NONE_MATCH),
)
async def look(request: Request, service: ServiceOfRequest, job_id: JobId, viewer: Viewer) -> Response:
    """Show a job; with `Prefer: wait=N` once it differs from what the client has, after N seconds at most."""
    record = await service.jobs.get(job_id, viewer)
    wait_s = min(Preferences.of(request).wait_s or 0, LONGEST_POLL_S)
    if wait_s and not record.state.final and _is_known(request, record):
        changed = service.jobs.changed(job_id, viewer, record.version, wait_s)
        record = await unless_gone(request, changed)
    headers = Preferences(wait_s).applied if wait_s else {}
    if has_already(request, etag_of_job(record)):
        return not_modified(headers | {"ETag": etag_of_job(record)})
    return job_response(record, headers=headers)


def _is_known(request: Request, record: JobRecord) -> bool:
    """Whether only a later version would tell the client anything; one that does not say waits for that."""
    return not asks_for_changes(request) or has_already(request, etag_of_job(record))


@router.get(
    "/v1/jobs/{job_id}/result",
    summary="Get the result of a job",
    response_class=Response,
    responses=openapi.refined(OFFERED, "ETag")
    | openapi.bare(304, "The client has this result.", "ETag")
    | _OF_ONE
    | problems(406, 409, 410, 422),
    openapi_extra=openapi.takes(openapi.IF_NONE_MATCH),
)
async def result(request: Request, service: ServiceOfRequest, job_id: JobId, viewer: Viewer) -> Response:
    """Give the refined map in the media type that `Accept` asks for."""
    return await stored_result(service.jobs, await service.jobs.get(job_id, viewer), request)


@router.get(
    "/v1/jobs/{job_id}/events",
    summary="Follow a job by server-sent events",
    response_class=Response,
    responses=openapi.event_stream() | _OF_ONE,
    openapi_extra=openapi.takes(openapi.LAST_EVENT_ID),
)
async def events(request: Request, service: ServiceOfRequest, job_id: JobId, viewer: Viewer) -> Response:
    """Send the job now and after each change until it has ended, as `state` or `progress`."""
    record, seen = await service.jobs.get(job_id, viewer), last_seen(request)
    if record.state.final and record.version == seen:
        return Response(status_code=204)

    async def changed(known: JobRecord, timeout_s: float) -> JobRecord | None:
        now = await service.jobs.changed(job_id, viewer, known.version, timeout_s)
        return None if service.jobs.ending and now.version == known.version else now

    # A proxy that gathers a stream before it passes it on would hold it up.
    return EventSourceResponse(events_of(record, seen, changed), headers={"X-Accel-Buffering": "no"})


@router.post(
    "/v1/jobs/{job_id}/cancel",
    summary="Cancel a job",
    response_class=Response,
    responses=openapi.document(200, JobDocument, examples.RUNNING_JOB, "ETag") | _OF_ONE | problems(409),
)
async def cancel(service: ServiceOfRequest, job_id: JobId, viewer: Viewer) -> Response:
    """Cancel a job that waits at once, one that runs soon; 409 if it has ended otherwise."""
    return job_response(await service.jobs.cancel(job_id, viewer))


@router.delete(
    "/v1/jobs/{job_id}",
    summary="Delete a job with all that was sent and all that came of it",
    status_code=204,
    response_class=Response,
    responses=openapi.bare(204, "Nothing of the job is left.") | _OF_ONE,
)
async def purge(service: ServiceOfRequest, job_id: JobId, viewer: Viewer) -> Response:
    """Delete a job now, whatever its state."""
    await service.jobs.purge(job_id, viewer)
    return Response(status_code=204)
