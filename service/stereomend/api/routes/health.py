"""GET /livez and /readyz, for whoever watches over the server; they need no key."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import APIRouter

from stereomend.api.openapi import problems
from stereomend.api.schemas import Liveness, Readiness
from stereomend.api.state import ServiceOfRequest

router = APIRouter(tags=["health"])


@router.get("/livez", summary="Whether the server answers")
async def livez() -> Liveness:
    """Answer."""
    return Liveness()


@router.get("/readyz", summary="Whether a worker is up", responses=problems(503))
async def readyz(service: ServiceOfRequest) -> Readiness:
    """Say which backend computes here, and why; 503 while no worker is up."""
    pool = service.pool
    return Readiness(**asdict(pool.hello()), workers_up=pool.workers_up, workers=service.settings.workers)
