"""The client that is awaited."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Mapping
from types import TracebackType
from typing import Any, Self

import httpx

from stereomend.client import job_messages, messages
from stereomend.client.jobs import AsyncJob
from stereomend.client.links import AsyncLink
from stereomend.client.messages import Connection, File, Inputs
from stereomend.client.patience import RESTART_S, Patience
from stereomend.disparity import RefinementResult


class AsyncClient:
    """`Client` for asyncio: the same verbs and errors, to be awaited. Files are read in threads.

    ```
    async with AsyncClient("http://127.0.0.1:8000") as client:
        results = await asyncio.gather(*(client.refine(*frame) for frame in frames))
    ```

    Args:
        base_url: such as `http://127.0.0.1:8000`.
        api_key: needed where the server has keys.
        timeout: seconds to wait for one answer.
    """

    def __init__(self, base_url: str, api_key: str | None = None, timeout: float = 330.0) -> None:
        self._link = AsyncLink(Connection(base_url, api_key, timeout))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Close all connections."""
        await self._link.close()

    async def refine(
        self,
        left: File,
        right: File,
        disparity: File | None = None,
        *,
        mask: File | None = None,
        **params: object,
    ) -> RefinementResult:
        """See `Client.refine`. Cancelled while the server has not begun, it costs the server no work."""
        messages.check_whole(params)
        response = await self._refine(Inputs(left, right, disparity, mask, params))
        return await asyncio.to_thread(messages.read_result, response)

    async def refine_bytes(  # noqa: PLR0913 - as `Client.refine_bytes`
        self,
        left: File,
        right: File,
        disparity: File | None = None,
        params: Mapping[str, object] | None = None,
        accept: str = messages.ZIP,
        *,
        mask: File | None = None,
    ) -> tuple[bytes, Mapping[str, str]]:
        """See `Client.refine_bytes`."""
        response = await self._refine(Inputs(left, right, disparity, mask, params or {}), accept)
        return response.content, response.headers

    async def submit(
        self,
        left: File,
        right: File,
        disparity: File | None = None,
        *,
        mask: File | None = None,
        idempotency_key: str | None = None,
        **params: object,
    ) -> AsyncJob:
        """See `Client.submit`."""
        messages.check_whole(params)
        inputs = Inputs(left, right, disparity, mask, params)
        request = await asyncio.to_thread(job_messages.submission, inputs, idempotency_key)
        response = await self._link.ask(request, Patience(RESTART_S))
        return AsyncJob(self._link, job_messages.status_of(response))

    async def job(self, job_id: str) -> AsyncJob:
        """See `Client.job`."""
        response = await self._link.ask(job_messages.look(job_id), Patience(RESTART_S))
        return AsyncJob(self._link, job_messages.status_of(response))

    async def jobs(self, state: str | None = None) -> AsyncGenerator[AsyncJob, None]:
        """See `Client.jobs`."""
        cursor = None
        while True:
            response = await self._link.ask(job_messages.page(state, cursor), Patience(RESTART_S))
            found, cursor = job_messages.read_page(response)
            for status in found:
                yield AsyncJob(self._link, status)
            if cursor is None:
                return

    async def presets(self) -> dict[str, Any]:
        """See `Client.presets`."""
        return messages.read_document(await self._link.ask(messages.document(messages.PRESETS)))

    async def health(self) -> dict[str, Any]:
        """See `Client.health`."""
        return messages.read_document(await self._link.ask(messages.document(messages.ALIVE)))

    async def ready(self) -> dict[str, Any]:
        """See `Client.ready`."""
        return messages.read_document(await self._link.ask(messages.document(messages.READY)))

    async def _refine(self, inputs: Inputs, accept: str = messages.ZIP) -> httpx.Response:
        request = await asyncio.to_thread(messages.refinement, inputs, accept)
        return await self._link.ask(request, Patience())
