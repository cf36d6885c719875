"""What every request gets: an id, a log line, and an answer even to a fault of ours."""

from __future__ import annotations

import logging
import re
from time import perf_counter
from urllib.parse import quote
from uuid import uuid4

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from stereomend.api.problems import Problem
from stereomend.errors import InternalError

log = logging.getLogger("stereomend.requests")

REQUEST_ID = "X-Request-ID"
_SANE_ID = re.compile(r"[A-Za-z0-9._:-]{1,128}")


class Envelope:
    """ASGI middleware, outermost: request ids, one log line per request, and 500 as a problem document."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        exchange = _Exchange(scope, send)
        try:
            await self._app(scope, receive, exchange.send)
        except Exception:
            await self._apologise(exchange, receive)
        finally:
            exchange.log()

    async def _apologise(self, exchange: _Exchange, receive: Receive) -> None:
        log.exception("request %s failed", exchange.request_id)
        if exchange.status is None:
            error = InternalError("a fault of the server's; its log has the details under this request id")
            await Problem(error, exchange.scope)(exchange.scope, receive, exchange.send)


class _Exchange:
    def __init__(self, scope: Scope, send: Send) -> None:
        self.scope = scope
        self.status: int | None = None
        given = Headers(scope=scope).get(REQUEST_ID, "")
        self.request_id = given if _SANE_ID.fullmatch(given) else uuid4().hex
        scope.setdefault("state", {})["request_id"] = self.request_id
        self._send = send
        self._began = perf_counter()

    async def send(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.status = message["status"]
            MutableHeaders(scope=message)[REQUEST_ID] = self.request_id
        await self._send(message)

    def log(self) -> None:
        fields = {
            "method": self.scope["method"],
            "path": quote(self.scope["path"]),
            "status": self.status or 0,
            "ms": round(1e3 * (perf_counter() - self._began), 3),
            "request_id": self.request_id,
        }
        text = "{method} {path} {status} {ms} ms {request_id}".format(**fields)
        log.info("%s", text, extra={"fields": fields})
