"""What a client would rather have, RFC 7240: `Prefer: wait=10` and `Prefer: respond-async`."""

from __future__ import annotations

import re
from typing import NamedTuple

from starlette.requests import Request

LONGEST_POLL_S = 60
"""No request waits longer than this for a change of a job; proxies would cut it off."""

# Commas within a quoted string part nothing.
_PREFERENCE = re.compile(r'(?:[^,"]|"(?:[^"\\]|\\.)*")+')
_MOST_DIGITS = 9


class Preferences(NamedTuple):
    """The preferences that are known here; others, and broken ones, count as not given."""

    wait_s: int | None = None
    """Answer within so many seconds."""
    respond_async: bool = False
    """Answer at once; `wait_s`, where given, says what at once means."""

    @classmethod
    def of(cls, request: Request) -> Preferences:
        """Read the header `Prefer` of a request; of a preference that comes twice the first counts."""
        given: dict[str, str] = {}
        for preference in _PREFERENCE.findall(", ".join(request.headers.getlist("prefer"))):
            name, _, value = preference.partition(";")[0].partition("=")
            given.setdefault(name.strip().lower(), value.strip().strip('"'))
        return cls(_seconds(given.get("wait", "")), "respond-async" in given)

    @property
    def patience_s(self) -> int | None:
        """Seconds to wait for a result before the request becomes a job; None: it never does."""
        return 0 if self.wait_s is None and self.respond_async else self.wait_s

    @property
    def applied(self) -> dict[str, str]:
        """The header `Preference-Applied` of an answer that honours them."""
        names = ("respond-async" if self.respond_async else "", _wait(self.wait_s))
        honoured = ", ".join(name for name in names if name)
        return {"Preference-Applied": honoured} if honoured else {}


def _seconds(text: str) -> int | None:
    return int(text) if text.isdecimal() and len(text) <= _MOST_DIGITS else None


def _wait(seconds: int | None) -> str:
    return "" if seconds is None else f"wait={seconds}"
