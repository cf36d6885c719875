"""The ways to a server: one that waits, and its twin that is awaited."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncGenerator, Iterator
from contextlib import aclosing

import httpx
import httpx_sse

from stereomend.client import messages
from stereomend.client.messages import Connection, Request
from stereomend.client.patience import Patience
from stereomend.errors import StereomendError


class Link:
    """Connections to a server, kept open."""

    def __init__(self, connection: Connection) -> None:
        self._http = httpx.Client(**connection.options())

    def close(self) -> None:
        """Close all connections."""
        self._http.close()

    def ask(self, request: Request, patience: Patience | None = None) -> httpx.Response:
        """Send a request, again while `patience` lasts (raises the error that the answer tells of).

        Raises:
            NotReady: nobody answered.
        """
        while True:
            try:
                return self._send(request)
            except StereomendError as error:
                if patience is None:
                    raise
                pause = patience.pause_after(error)
            time.sleep(pause)

    def events(self, request: Request) -> Iterator[httpx_sse.ServerSentEvent]:
        """Give the events of a stream until it ends; errors as `ask`."""
        with messages.reaching(self._http.base_url), self._http.stream(**request) as response:
            if not messages.is_stream(response):
                response.read()
                messages.check_empty(response)
                return
            yield from httpx_sse.EventSource(response).iter_sse()

    def _send(self, request: Request) -> httpx.Response:
        with messages.reaching(self._http.base_url):
            response = self._http.request(**request)
        return messages.accepted(response)


class AsyncLink:
    """`Link` for asyncio."""

    def __init__(self, connection: Connection) -> None:
        self._http = httpx.AsyncClient(**connection.options())

    async def close(self) -> None:
        """See `Link.close`."""
        await self._http.aclose()

    async def ask(self, request: Request, patience: Patience | None = None) -> httpx.Response:
        """See `Link.ask`."""
        while True:
            try:
                return await self._send(request)
            except StereomendError as error:
                if patience is None:
                    raise
                pause = patience.pause_after(error)
            await asyncio.sleep(pause)

    async def events(self, request: Request) -> AsyncGenerator[httpx_sse.ServerSentEvent, None]:
        """See `Link.events`."""
        with messages.reaching(self._http.base_url):
            async with self._http.stream(**request) as response:
                if not messages.is_stream(response):
                    await response.aread()
                    messages.check_empty(response)
                    return
                async with aclosing(httpx_sse.EventSource(response).aiter_sse()) as events:
                    async for event in events:
                        yield event

    async def _send(self, request: Request) -> httpx.Response:
        with messages.reaching(self._http.base_url):
            response = await self._http.request(**request)
        return messages.accepted(response)
