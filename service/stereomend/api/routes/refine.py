"""POST /v1/refine: a refinement that is waited for."""

from __future__ import annotations

from fastapi import APIRouter, Request
from starlette.responses import Response

from stereomend.api import examples, openapi
from stereomend.api.job_documents import OFFERED, JobDocument
from stereomend.api.job_responses import accepted_response
from stereomend.api.negotiation import choose
from stereomend.api.openapi import problems
from stereomend.api.owners import Owner
from stereomend.api.preferences import Preferences
from stereomend.api.results import result_response
from stereomend.api.state import ServiceOfRequest
from stereomend.api.stored_results import stored_result
from stereomend.api.submissions import read_submission
from stereomend.api.uploads import check_headers
from stereomend.api.waiting import unless_gone
from stereomend.codec import check_calibrated
from stereomend.jobs.task import Answer

router = APIRouter(tags=["refine"])


@router.post(
    "/v1/refine",
    summary="Mend a disparity map",
    response_class=Response,
    responses=openapi.refined(OFFERED, "Preference-Applied")
    | openapi.document(202, JobDocument, examples.RUNNING_JOB, *openapi.OF_ACCEPTED, "Preference-Applied")
    | problems(400, 401, 403, 406, 409, 410, 413, 415, 422, 429, 500, 503, 507),
    openapi_extra=openapi.takes(openapi.PREFER_JOB, openapi.IDEMPOTENCY_KEY, body=True),
)
async def refine(request: Request, service: ServiceOfRequest, owner: Owner) -> Response:
    """Refine one stereo pair and wait for the result, in the media type that `Accept` asks for.

    Without a disparity map, OpenCV's SGBM provides the initial one. With `Prefer`, what takes longer than the
    client waits goes on as a job.
    """
    wants = Preferences.of(request)
    media_type = choose(", ".join(request.headers.getlist("accept")), OFFERED)
    check_headers(request, service.settings.max_upload_mb << 20)
    if wants.patience_s != 0:
        service.pool.check_room()
    submission = await read_submission(request, service.settings, owner)
    check_calibrated(media_type, submission.params.calibrated)
    outcome = await unless_gone(request, service.jobs.refine(submission, media_type, wants.patience_s))
    if isinstance(outcome, Answer):
        return result_response(outcome, wants.applied)
    if outcome.record.state.final:
        return await stored_result(service.jobs, outcome.record, request)
    return accepted_response(outcome, wants.applied)
