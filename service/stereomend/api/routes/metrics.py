"""GET /metrics: figures for Prometheus; needs the scope `read` where the server needs keys."""

from __future__ import annotations

import asyncio

from fastapi import APIRouter
from prometheus_client import CONTENT_TYPE_LATEST
from starlette.responses import Response

from stereomend.api.figures import figures_of
from stereomend.api.openapi import Responses, problems
from stereomend.api.state import ServiceOfRequest

router = APIRouter(tags=["health"])

_TEXT: Responses = {200: {"description": "Prometheus' text format.", "content": {"text/plain": {}}}}


@router.get(
    "/metrics",
    summary="What was counted, and what waits and runs now",
    response_class=Response,
    responses=_TEXT | problems(401, 403, 503),
)
async def metrics(service: ServiceOfRequest) -> Response:
    """Tell the depth of the queue, stages' durations, refusals, restarts, outcomes and free disk space."""
    figures = await figures_of(service)
    text = await asyncio.to_thread(service.meters.text, figures)
    return Response(text, headers={"Content-Type": CONTENT_TYPE_LATEST})
