"""The client that is awaited."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

import httpx

from stereomend.client import messages
from stereomend.client.messages import Connection, File, Inputs
from stereomend.client.patience import Patience
from stereomend.disparity import RefinementResult
from stereomend.errors import Unavailable


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
        self._http = httpx.AsyncClient(**Connection(base_url, api_key, timeout).options())

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Close all connections."""
        await self._http.aclose()

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
        response = await self._refine(Inputs(left, right, disparity, mask, params), messages.ZIP)
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

    async def presets(self) -> dict[str, Any]:
        """See `Client.presets`."""
        return messages.read_document(await self._send(messages.document(messages.PRESETS)))

    async def health(self) -> dict[str, Any]:
        """See `Client.health`."""
        return messages.read_document(await self._send(messages.document(messages.ALIVE)))

    async def ready(self) -> dict[str, Any]:
        """See `Client.ready`."""
        return messages.read_document(await self._send(messages.document(messages.READY)))

    async def _refine(self, inputs: Inputs, accept: str) -> httpx.Response:
        request, patience = await asyncio.to_thread(messages.refinement, inputs, accept), Patience()
        while True:
            try:
                return await self._send(request)
            except Unavailable as error:
                pause = patience.pause_after(error)
            await asyncio.sleep(pause)

    async def _send(self, request: dict[str, Any]) -> httpx.Response:
        with messages.reaching(self._http.base_url):
            response = await self._http.request(**request)
        return messages.accepted(response)
