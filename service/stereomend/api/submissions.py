"""From a request's body to what is to be refined."""

from __future__ import annotations

from starlette.requests import Request

from stereomend.api.idempotency import idempotency_key
from stereomend.api.job_options import take_options
from stereomend.api.uploads import PARAMS, check_headers, read_params, read_parts
from stereomend.jobs.service import Submission
from stereomend.jobs.task import Files
from stereomend.refinement import parse_params
from stereomend.settings import Settings


async def read_submission(request: Request, settings: Settings, owner: str) -> Submission:
    """Read and check a request for a refinement, all but its images.

    Raises:
        UnknownFormat, BodyTooLarge, MalformedRequest: as `read_parts` and `check_headers`.
        InvalidParameter: the parameters cannot be read, are unknown or out of range.
    """
    key, most = idempotency_key(request), settings.max_upload_mb << 20
    check_headers(request, most)
    parts = await read_parts(request, most)
    options, params = take_options(read_params(parts.get(PARAMS, b"{}")))
    return Submission(
        files=Files(parts["left"], parts["right"], parts.get("disparity"), mask=parts.get("mask")),
        params=parse_params(params),
        owner=owner,
        request_id=request.state.request_id,
        traceparent=getattr(request.state, "traceparent", None),
        idempotency_key=key,
        **options.model_dump(),
    )
