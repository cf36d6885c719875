"""Who may ask: API keys and their scopes, or, where no key is needed, this machine's own programs."""

from __future__ import annotations

from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from stereomend.api.keyring import LOCAL, KeyRing, Principal
from stereomend.api.problems import Problem
from stereomend.errors import AccessDenied, Forbidden, StereomendError
from stereomend.jobs.keys import READ, SUBMIT
from stereomend.settings import LOOPBACK

OPEN_PATHS = ("/livez", "/readyz", "/docs", "/openapi.json")
"""Probes, and the documents that describe the API to a browser, which sends no key for a page."""

ANY_SCOPE_PATHS = ("/v1/presets",)
"""What every key may read, as it must know what to send."""

_SAFE_METHODS = ("GET", "HEAD", "OPTIONS")


class Gate:
    """ASGI middleware that refuses before any of the body is read, and says who asks.

    `scope["state"]` gets `owner`, the id of the key or `local`, and `scopes`, a frozenset of what it may.
    """

    def __init__(self, app: ASGIApp, ring: KeyRing) -> None:
        self._app = app
        self._ring = ring

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer it with 401, 403 or 503."""
        app = self._app
        if scope["type"] == "http":
            try:
                await self._admit(scope)
            except StereomendError as refusal:
                app = Problem(refusal, scope)
        await app(scope, receive, send)

    async def _admit(self, scope: Scope) -> None:
        headers = Headers(scope=scope)
        if not await self._ring.needed():
            _check_local(headers)
            _tell(scope, LOCAL)
        elif not _is_open(scope["path"]):
            principal = await self._ring.find(_bearer(headers.get("authorization", "")))
            if principal is None:
                raise AccessDenied("send an API key: `Authorization: Bearer <key>`")
            _tell(scope, principal)
            _check_scope(scope, principal)


def _tell(scope: Scope, principal: Principal) -> None:
    scope["state"] |= {"owner": principal.owner, "scopes": principal.scopes}


def _is_open(path: str) -> bool:
    return path in OPEN_PATHS or path.startswith("/docs/")


def _bearer(authorization: str) -> str:
    scheme, _, key = authorization.partition(" ")
    return key.strip() if scheme.lower() == "bearer" else ""


def _check_scope(scope: Scope, principal: Principal) -> None:
    if scope["path"] in ANY_SCOPE_PATHS:
        return
    needed = READ if scope["method"] in _SAFE_METHODS else SUBMIT
    if needed not in principal.scopes:
        has = ", ".join(sorted(principal.scopes))
        raise Forbidden(f"the key has the scope {has}; {scope['method']} needs {needed}")


def _check_local(headers: Headers) -> None:
    """Refuse what a web page could make a browser send: without keys that would be all it takes."""
    for name, url in (("Host", f"//{headers.get('host', '')}"), ("Origin", headers.get("origin"))):
        if url is not None and _hostname(url) not in LOOPBACK:
            raise Forbidden(
                f"{name} is {headers.get(name)!r}; without API keys only {', '.join(LOOPBACK)} are served"
            )


def _hostname(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None
