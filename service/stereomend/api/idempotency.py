"""`Idempotency-Key`: a request that is sent twice, since its answer was lost, is one job."""

from __future__ import annotations

import re

from starlette.requests import Request

from stereomend.errors import MalformedRequest

HEADER = "Idempotency-Key"
_KEY = re.compile(r"[\x21-\x7e]{1,255}")


def idempotency_key(request: Request) -> str | None:
    """The key of a request (raises MalformedRequest if it is no key, or there are several)."""
    given = request.headers.getlist(HEADER)
    if not given:
        return None
    if len(given) > 1 or not _KEY.fullmatch(given[0]):
        raise MalformedRequest(
            f"{HEADER} came as {', '.join(map(repr, given))[:300]}; "
            "expected one of 1 to 255 visible ASCII characters"
        )
    return given[0]
