"""Entity tags, RFC 9110 section 13: an answer that the client has already is not sent again."""

from __future__ import annotations

import re
from collections.abc import Mapping
from hashlib import sha256

from starlette.requests import Request
from starlette.responses import Response

_TAG = re.compile(r'(?:W/)?("[^"]*")')


def etag_of(*facts: object) -> str:
    """The tag of what these facts determine, such as the hash of a result and a media type."""
    return f'"{sha256(repr(facts).encode()).hexdigest()[:32]}"'


def asks_for_changes(request: Request) -> bool:
    """Whether the client names what it has already."""
    return "if-none-match" in request.headers


def has_already(request: Request, etag: str) -> bool:
    """Whether `If-None-Match` names this tag, by weak comparison."""
    given = ", ".join(request.headers.getlist("if-none-match"))
    return given.strip() == "*" or etag in _TAG.findall(given)


def not_modified(headers: Mapping[str, str]) -> Response:
    """Answer 304 with the headers that the whole answer would have."""
    return Response(status_code=304, headers=headers)
