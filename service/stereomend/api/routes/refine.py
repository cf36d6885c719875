"""POST /v1/refine: a refinement that is waited for."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from fastapi import APIRouter, Request
from starlette.responses import Response

from stereomend.api.negotiation import choose
from stereomend.api.openapi import REFINE_BODY, problems, refined
from stereomend.api.state import ServiceOfRequest
from stereomend.api.uploads import check_headers, read_params, read_parts
from stereomend.api.waiting import unless_gone
from stereomend.codec import MEDIA_TYPES, PREVIEW_TYPE, check_calibrated
from stereomend.jobs.task import TIMINGS, Answer, Task
from stereomend.refinement import COPIES, parse_params

router = APIRouter(tags=["refine"])

OFFERED = tuple(dict.fromkeys(("image/png", *MEDIA_TYPES.values(), PREVIEW_TYPE)))
"""The media types of a result; the first is the default."""

_ZIP = "application/zip"
_LONGEST_META = 4096


@router.post(
    "/v1/refine",
    summary="Mend a disparity map",
    response_class=Response,
    responses=refined(OFFERED) | problems(400, 401, 403, 406, 413, 415, 422, 429, 500, 503),
    openapi_extra=REFINE_BODY,
)
async def refine(request: Request, service: ServiceOfRequest) -> Response:
    """Refine one stereo pair and wait for the result, in the media type that `Accept` asks for.

    Without a disparity map, OpenCV's SGBM provides the initial one.
    """
    most = service.settings.max_upload_mb << 20
    media_type = choose(", ".join(request.headers.getlist("accept")), OFFERED)
    check_headers(request, most)
    service.pool.check_room()
    parts = await read_parts(request, most)
    task = _task(parts, media_type, request)
    return _response(await unless_gone(request, service.pool.submit(task)))


def _task(parts: Mapping[str, bytes], media_type: str, request: Request) -> Task:
    params = parse_params(read_params(parts.get("params", b"{}")))
    check_calibrated(media_type, params.calibrated)
    files = {name: parts.get(name) for name in ("disparity", "mask")}
    return Task(
        parts["left"],
        parts["right"],
        **files,
        params=params,
        media_type=media_type,
        request_id=request.state.request_id,
        traceparent=getattr(request.state, "traceparent", None),
    )


def _response(answer: Answer) -> Response:
    known = (name for name in (*TIMINGS, *COPIES) if name in answer.timings)
    timing = ", ".join(f"{name};dur={answer.timings[name]:.3f}" for name in known)
    headers = {"Server-Timing": timing}
    if answer.media_type != _ZIP:
        headers["Stereomend-Meta"] = _meta(answer.meta)
    return Response(answer.body, media_type=answer.media_type, headers=headers)


def _meta(meta: Mapping[str, Any]) -> str:
    text = json.dumps(meta, separators=(",", ":"))
    if len(text) <= _LONGEST_META:
        return text
    # Proxies limit headers, and the client knows what it asked for.
    return (
        _meta({name: value for name, value in meta.items() if name != "params"}) if "params" in meta else text
    )
