"""A refinement on a server, watched on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from stereomend.client import Client, File, Job, JobStatus
from stereomend.disparity import RefinementResult
from stereomend.errors import NotFound, StereomendError

_WIDTH = 24
_CLEARED = "\r\x1b[K"


def refine_watched(
    client: Client,
    files: tuple[File, File, File | None],
    mask: File | None,
    params: Mapping[str, Any],
) -> RefinementResult:
    """Refine as a job and show on stderr how far it is; nothing of the job is left on the server.

    A server that has no jobs refines without telling. Errors as `Client.refine` and `Job.result`.
    """
    if not _has_jobs(client):
        return client.refine(*files, mask=mask, **params)
    job = client.submit(*files, mask=mask, **params)
    try:
        return _watched(job)
    finally:
        # Also when somebody gives up: nobody else knows the job.
        with suppress(StereomendError):
            job.delete()


def progress_line(status: JobStatus) -> str:
    """One line that says how far a job is."""
    if status.state != "running":
        return status.state
    done, total = status.steps
    if not total:
        return status.phase
    filled = _WIDTH * done // total
    return f"{status.phase:8s}[{'#' * filled}{'.' * (_WIDTH - filled)}] {done}/{total}"


def _has_jobs(client: Client) -> bool:
    # To ask first is cheaper than to send images in vain.
    try:
        next(client.jobs(), None)
    except NotFound:
        return False
    return True


def _watched(job: Job) -> RefinementResult:
    try:
        for status in job.events():
            print(f"{_CLEARED}{progress_line(status)}", end="", file=sys.stderr, flush=True)
    finally:
        print(_CLEARED, end="", file=sys.stderr, flush=True)
    if job.status.error is not None:
        # As if it had been waited for: how it was done is of no interest.
        raise job.status.as_error()
    return job.result()
