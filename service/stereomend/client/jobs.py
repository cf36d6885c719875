"""Jobs on a server: one that is waited for, and its twin that is awaited."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncGenerator, Iterator
from contextlib import aclosing, suppress
from typing import Generic, Self, TypeVar

from stereomend.client import job_messages, messages
from stereomend.client.job_messages import Deadline, JobStatus
from stereomend.client.links import AsyncLink, Link
from stereomend.client.patience import OUTAGE_S, Patience
from stereomend.disparity import RefinementResult
from stereomend.errors import JobNotFound, StereomendError

_Way = TypeVar("_Way")

_BETWEEN_STREAMS_S = 0.25


class _KnownJob(Generic[_Way]):
    def __init__(self, link: _Way, status: JobStatus) -> None:
        self._link = link
        self.status = status
        """As the server showed it last."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.id} {self.state}>"

    @property
    def id(self) -> str:
        """Names the job, also for `Client.job` of another process."""
        return self.status.id

    @property
    def state(self) -> str:
        """`queued`, `running`, `succeeded`, `failed`, `cancelled` or `expired`, as known last."""
        return self.status.state


class Job(_KnownJob[Link]):
    """A refinement that the server has accepted and will not lose; made by `Client`.

    A server that is out of reach for a moment, as when it is restarted, is waited for. Every method may raise
    JobNotFound: the job was deleted or its record has expired, AccessDenied, and NotReady.
    """

    def refresh(self) -> Self:
        """Look at the job as it is now."""
        return self._take(job_messages.look(self.id))

    def wait(self, timeout: float | None = None) -> Self:
        """Wait until the job has ended, in whatever way; `timeout` in seconds.

        Raises:
            JobNotFinished: it has not ended in time.
        """
        deadline = Deadline(timeout)
        while not self.status.ended:
            self._take(job_messages.poll(self.status, deadline.poll_s(self.status)), deadline.left_s)
        return self

    def events(self) -> Iterator[JobStatus]:
        """Give the job as it is and after each change, until it has ended."""
        seen, patience = None, Patience(OUTAGE_S)
        while True:
            pause = _BETWEEN_STREAMS_S
            try:
                for event in self._link.events(job_messages.follow(self.status, seen)):
                    if status := job_messages.status_in(event):
                        self.status, seen, patience = status, status.version, Patience(OUTAGE_S)
                        yield status
            except StereomendError as error:
                pause = patience.pause_after(error)
            if self.status.ended and seen is not None:
                return
            time.sleep(pause)

    def result(self) -> RefinementResult:
        """Fetch the result.

        Raises:
            JobNotFinished, JobFailed, JobCancelled: there is none.
            ResultExpired: there was one.
        """
        return messages.read_result(self._link.ask(job_messages.result(self.status), Patience(OUTAGE_S)))

    def cancel(self) -> Self:
        """Cancel the job: at once if it waits, soon if it runs (raises JobFinished: it has ended)."""
        return self._take(job_messages.cancellation(self.status))

    def delete(self) -> None:
        """Delete the job with all that was sent and all that came of it, whatever its state."""
        with suppress(JobNotFound):
            self._link.ask(job_messages.deletion(self.status), Patience(OUTAGE_S))

    def _take(self, request: messages.Request, outage_s: float = OUTAGE_S) -> Self:
        response = self._link.ask(request, Patience(min(OUTAGE_S, outage_s)))
        self.status = job_messages.status_of(response, self.status)
        return self


class AsyncJob(_KnownJob[AsyncLink]):
    """`Job` for asyncio; made by `AsyncClient`."""

    async def refresh(self) -> Self:
        """See `Job.refresh`."""
        return await self._take(job_messages.look(self.id))

    async def wait(self, timeout: float | None = None) -> Self:
        """See `Job.wait`."""
        deadline = Deadline(timeout)
        while not self.status.ended:
            await self._take(job_messages.poll(self.status, deadline.poll_s(self.status)), deadline.left_s)
        return self

    async def events(self) -> AsyncGenerator[JobStatus, None]:
        """See `Job.events`."""
        seen, patience = None, Patience(OUTAGE_S)
        while True:
            pause = _BETWEEN_STREAMS_S
            try:
                async with aclosing(self._link.events(job_messages.follow(self.status, seen))) as events:
                    async for event in events:
                        if status := job_messages.status_in(event):
                            self.status, seen, patience = status, status.version, Patience(OUTAGE_S)
                            yield status
            except StereomendError as error:
                pause = patience.pause_after(error)
            if self.status.ended and seen is not None:
                return
            await asyncio.sleep(pause)

    async def result(self) -> RefinementResult:
        """See `Job.result`."""
        response = await self._link.ask(job_messages.result(self.status), Patience(OUTAGE_S))
        return await asyncio.to_thread(messages.read_result, response)

    async def cancel(self) -> Self:
        """See `Job.cancel`."""
        return await self._take(job_messages.cancellation(self.status))

    async def delete(self) -> None:
        """See `Job.delete`."""
        with suppress(JobNotFound):
            await self._link.ask(job_messages.deletion(self.status), Patience(OUTAGE_S))

    async def _take(self, request: messages.Request, outage_s: float = OUTAGE_S) -> Self:
        response = await self._link.ask(request, Patience(min(OUTAGE_S, outage_s)))
        self.status = job_messages.status_of(response, self.status)
        return self
