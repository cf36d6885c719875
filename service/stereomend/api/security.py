"""Who may ask: API keys, or, where there are none, nobody but this machine's own programs."""

from __future__ import annotations

import hmac
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from stereomend.api.problems import Problem
from stereomend.errors import AccessDenied, Forbidden
from stereomend.settings import LOOPBACK, Settings

OPEN_PATHS = ("/livez", "/readyz", "/docs", "/openapi.json")
"""Probes, and the documents that describe the API to a browser, which sends no key for a page."""


class Gate:
    """ASGI middleware that refuses before any of the body is read."""

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self._app = app
        self._keys = [key.get_secret_value().encode() for key in settings.api_keys]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer it with 401 or 403."""
        refusal = self._refusal(scope) if scope["type"] == "http" else None
        app = self._app if refusal is None else Problem(refusal, scope)
        await app(scope, receive, send)

    def _refusal(self, scope: Scope) -> AccessDenied | None:
        headers = Headers(scope=scope)
        if not self._keys:
            return _from_elsewhere(headers)
        if _is_open(scope["path"]) or self._knows(headers.get("authorization", "")):
            return None
        return AccessDenied("send an API key: `Authorization: Bearer <key>`")

    def _knows(self, authorization: str) -> bool:
        scheme, _, given = authorization.partition(" ")
        # All keys are compared, so that the time taken does not tell which one was close.
        matches = [hmac.compare_digest(given.strip().encode(), key) for key in self._keys]
        return scheme.lower() == "bearer" and any(matches)


def _is_open(path: str) -> bool:
    return path in OPEN_PATHS or path.startswith("/docs/")


def _from_elsewhere(headers: Headers) -> Forbidden | None:
    """Refuse what a web page could make a browser send: without keys that would be all it takes."""
    for name, url in (("Host", f"//{headers.get('host', '')}"), ("Origin", headers.get("origin"))):
        if url is not None and _hostname(url) not in LOOPBACK:
            return Forbidden(
                f"{name} is {headers.get(name)!r}; without API keys only {', '.join(LOOPBACK)} are served"
            )
    return None


def _hostname(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None
