"""What the routes need of the running server."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, cast

from fastapi import Depends, Request

from stereomend.jobs.meters import Meters
from stereomend.jobs.pool import WorkerPool
from stereomend.jobs.service import JobService
from stereomend.settings import Settings


@dataclass(frozen=True)
class Service:
    """The settings of this server, its workers, its jobs, and what was counted."""

    settings: Settings
    pool: WorkerPool
    jobs: JobService
    meters: Meters


async def _service(request: Request) -> Service:
    # Not async, it would be handed to a thread, for half a millisecond.
    return cast(Service, request.app.state.service)


ServiceOfRequest = Annotated[Service, Depends(_service)]
