"""What goes to the server about jobs and how its answers are read, whoever does the waiting."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from time import monotonic
from typing import Any
from uuid import uuid4

import httpx
import httpx_sse

from stereomend.client.messages import ZIP, Inputs, Request, document, read_document, refinement
from stereomend.errors import InternalError, JobNotFinished, StereomendError, error_from_slug

JOBS = "/v1/jobs"

_LONGEST_POLL_S = 20.0
_MARGIN_S = 15.0
_SILENCE_S = 45.0  # a server sends a comment every 15 s
_FINAL = ("succeeded", "failed", "cancelled", "expired")


@dataclass(frozen=True)
class JobStatus:
    """A job as the server showed it last."""

    document: Mapping[str, Any]
    """All that the server tells."""

    @property
    def id(self) -> str:
        """Names the job."""
        return str(self.document["id"])

    @property
    def state(self) -> str:
        """`queued`, `running`, `succeeded`, `failed`, `cancelled` or `expired`."""
        return str(self.document["state"])

    @property
    def version(self) -> int:
        """Grows with every change."""
        return int(self.document["version"])

    @property
    def ended(self) -> bool:
        """Whether nothing more will be computed."""
        return self.state in _FINAL

    @property
    def phase(self) -> str:
        """What a running job is at, by the keys of `RefinementResult.timings`."""
        return str(self.document["progress"]["phase"])

    @property
    def steps(self) -> tuple[int, int]:
        """Steps of the phase that are done, and all of them; 0 of 0 where unknown."""
        progress = self.document["progress"]
        return progress["done"], progress["total"]

    @property
    def error(self) -> str | None:
        """Why it failed."""
        problem = self.document["error"]
        return None if problem is None else str(problem["detail"])

    def as_error(self) -> StereomendError:
        """What it failed with, as the exception that a refinement which is waited for would raise."""
        problem = self.document["error"] or {"type": "", "detail": f"job {self.id} has {self.state}"}
        return error_from_slug(str(problem["type"]).rpartition("/")[2], str(problem["detail"]))


class Deadline:
    """Seconds that are left of a wait; None: it has no end."""

    def __init__(self, timeout: float | None) -> None:
        self._end = math.inf if timeout is None else monotonic() + timeout

    @property
    def left_s(self) -> float:
        """Seconds, also below 0 and without end."""
        return self._end - monotonic()

    def poll_s(self, status: JobStatus) -> int:
        """Whole seconds to ask the server to wait for a change (raises JobNotFinished: none is left)."""
        if self.left_s <= 0:
            raise JobNotFinished(f"job {status.id} is still {status.state}")
        return max(1, math.ceil(min(self.left_s, _LONGEST_POLL_S)))


def submission(inputs: Inputs, key: str | None) -> Request:
    """Submit a job; it has a key, so that it can be sent twice."""
    request = refinement(inputs)
    headers = {"Accept": "application/json", "Idempotency-Key": key or uuid4().hex}
    return request | {"url": JOBS, "headers": request["headers"] | headers}


def look(job_id: str) -> Request:
    """Ask for a job as it is."""
    return document(f"{JOBS}/{job_id}")


def poll(status: JobStatus, wait_s: int) -> Request:
    """Ask for a job once it differs from `status`."""
    headers = {"If-None-Match": f'"{status.version}"', "Prefer": f"wait={wait_s}"}
    timeout = httpx.Timeout(wait_s + _MARGIN_S, pool=None)
    return {"method": "GET", "url": f"{JOBS}/{status.id}", "headers": headers, "timeout": timeout}


def follow(status: JobStatus, seen: int | None) -> Request:
    """Ask for the events of a job after the version `seen`."""
    headers = {"Accept": "text/event-stream"} | ({} if seen is None else {"Last-Event-ID": str(seen)})
    timeout = httpx.Timeout(_SILENCE_S, pool=None)
    return {"method": "GET", "url": f"{JOBS}/{status.id}/events", "headers": headers, "timeout": timeout}


def result(status: JobStatus) -> Request:
    """Ask for the result of a job."""
    return {"method": "GET", "url": f"{JOBS}/{status.id}/result", "headers": {"Accept": ZIP}}


def cancellation(status: JobStatus) -> Request:
    """Cancel a job."""
    return {"method": "POST", "url": f"{JOBS}/{status.id}/cancel"}


def deletion(status: JobStatus) -> Request:
    """Delete a job."""
    return {"method": "DELETE", "url": f"{JOBS}/{status.id}"}


def page(state: str | None, cursor: str | None) -> Request:
    """Ask for a page of jobs."""
    asked = {"state": state, "cursor": cursor}
    given = {name: value for name, value in asked.items() if value is not None}
    return document(JOBS) | {"params": given}


def read_page(response: httpx.Response) -> tuple[list[JobStatus], str | None]:
    """Read a page of jobs, and the cursor of the next; None: it is the last."""
    content = read_document(response)
    return [JobStatus(job) for job in content["jobs"]], content["next_cursor"]


def status_of(response: httpx.Response, known: JobStatus | None = None) -> JobStatus:
    """Read a job; 304 means that it is as `known` (raises InternalError if it is none)."""
    if response.status_code == httpx.codes.NOT_MODIFIED and known:
        return known
    return _status(response.text)


def status_in(event: httpx_sse.ServerSentEvent) -> JobStatus | None:
    """Read the job in an event; None: the event tells of none (raises InternalError)."""
    return _status(event.data) if event.data else None


def _status(text: str) -> JobStatus:
    try:
        content = json.loads(text)
        status = JobStatus(content)
        _ = status.id, status.state, status.version
    except (ValueError, KeyError, TypeError) as error:
        raise InternalError(f"the server's answer is no job: {error!r}") from error
    return status
