"""A job's changes as server-sent events; `data` of each is the whole job, `id` its version."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import suppress

from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event
from starlette.requests import Request

from stereomend.api.job_documents import job_document
from stereomend.errors import JobNotFound
from stereomend.jobs.records import JobRecord

KEEP_ALIVE_S = 15.0
"""A comment is sent after so long a silence, or proxies would take the connection for dead."""
_RETRY_MS = 1000

Changed = Callable[[JobRecord, float], Awaitable[JobRecord | None]]
"""Waits so many seconds at most for another version of a job; None: the server ends."""


def last_seen(request: Request) -> int | None:
    """The version that a client which comes again has seen, by `Last-Event-ID`; None: none."""
    given = request.headers.get("last-event-id", "")
    return int(given) if given.isdecimal() and len(given) < 20 else None


async def events_of(record: JobRecord, seen: int | None, changed: Changed) -> AsyncGenerator[bytes, None]:
    """Give the events from the first version that is not `seen` to the last, when the job has ended.

    An event is a `state` where the state may be new to the client, else a `progress`.
    """
    yield format_sse_event(retry=_RETRY_MS)
    told = None
    latest: JobRecord | None = record
    while latest:
        record = latest
        if record.version != seen:
            yield _event(record, "progress" if record.state == told else "state")
            seen, told = record.version, record.state
        else:
            yield KEEPALIVE_COMMENT
        if record.state.final:
            return
        # A job that is deleted has no more events; who comes again is told so.
        latest = None
        with suppress(JobNotFound):
            latest = await changed(record, KEEP_ALIVE_S)


def _event(record: JobRecord, kind: str) -> bytes:
    data = job_document(record).model_dump_json()
    return format_sse_event(data_str=data, event=kind, id=str(record.version))
