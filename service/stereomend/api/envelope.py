"""What every request gets: an id, safe headers, a line in the log, and an answer even to a fault of ours."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import Any
from uuid import uuid4

from starlette.datastructures import Headers, MutableHeaders
from starlette.routing import Mount, Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from stereomend.api.problems import Problem
from stereomend.errors import InternalError
from stereomend.jobs.meters import Meters

log = logging.getLogger("stereomend.requests")

REQUEST_ID = "X-Request-ID"
_SANE_ID = re.compile(r"[A-Za-z0-9._:-]{1,128}")
_JOB = re.compile(r"/v1/jobs/([0-9a-f]{32})(?![^/?#])")
_METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS")

NO_DETOURS = "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
"""The end of every content security policy: what `default-src` leaves open."""

SAFE_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": f"default-src 'none'; {NO_DETOURS}",
    # Results are a patient's, and what a job is changes.
    "Cache-Control": "no-store",
}
"""Of every answer that does not set them itself."""


class Envelope:
    """ASGI middleware, outermost: request ids, headers, one log line, figures, and 500 as a problem."""

    def __init__(self, app: ASGIApp, meters: Meters, routes: Sequence[Route | Mount]) -> None:
        self._app = app
        self._meters = meters
        self._routes = routes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        exchange = _Exchange(scope, send, _template(scope["path"], self._routes))
        try:
            await self._app(scope, receive, exchange.send)
        except Exception:
            await self._apologise(exchange, receive)
        finally:
            exchange.end(self._meters)

    async def _apologise(self, exchange: _Exchange, receive: Receive) -> None:
        log.exception("request %s failed", exchange.request_id)
        if exchange.status is None:
            error = InternalError("a fault of the server's; its log has the details under this request id")
            await Problem(error, exchange.scope)(exchange.scope, receive, exchange.send)


def method_of(scope: Scope) -> str:
    """The method of a request; `-` for one that a client made up."""
    return scope["method"] if scope["method"] in _METHODS else "-"


def log_access(fields: Mapping[str, Any], more: Mapping[str, str]) -> None:
    """Write the line of one access; `more` is for logs that are read by programs."""
    text = "{method} {route} {status} {ms} ms {request_id} key {key} job {job}".format(**fields)
    log.info("%s", text, extra={"fields": {**fields, **more}})


class _Exchange:
    def __init__(self, scope: Scope, send: Send, route: str) -> None:
        self.scope = scope
        self.status: int | None = None
        given = Headers(scope=scope).get(REQUEST_ID, "")
        self.request_id = given if _SANE_ID.fullmatch(given) else uuid4().hex
        self._state: dict[str, Any] = scope.setdefault("state", {})
        # The router is not asked: who is refused never gets there.
        self._state |= {"request_id": self.request_id, "route": route}
        self._job = _job_in(scope["path"])
        self._send = send
        self._began = perf_counter()

    async def send(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.status = message["status"]
            headers = MutableHeaders(scope=message)
            headers[REQUEST_ID] = self.request_id
            for name, value in SAFE_HEADERS.items():
                headers.setdefault(name, value)
            self._job = self._job or _job_in(headers.get("location", ""))
        await self._send(message)

    def end(self, meters: Meters) -> None:
        seconds = perf_counter() - self._began
        fields = {
            "key": self._state.get("owner", "-"),
            "method": method_of(self.scope),
            "route": self._state["route"],
            "status": self.status or 0,
            "ms": round(1e3 * seconds, 3),
            "request_id": self.request_id,
            "job": self._job or "-",
        }
        log_access(fields, self._more())
        meters.count_request((fields["method"], fields["route"], fields["status"]), seconds)
        if "problem" in self._state:
            meters.count_refusal(self._state["problem"])

    def _more(self) -> dict[str, str]:
        return {name: self._state[name] for name in ("problem", "trace_id") if name in self._state}


def _template(path: str, routes: Sequence[Route | Mount]) -> str:
    return next((route.path for route in routes if route.path_regex.match(path)), "-")


def _job_in(path: str) -> str | None:
    found = _JOB.search(path)
    return found[1] if found else None
