"""Content negotiation by `Accept`, RFC 9110 section 12.5.1."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

from python_multipart.multipart import parse_options_header

from stereomend.errors import NotAcceptable


class _Range(NamedTuple):
    name: str
    parameters: frozenset[tuple[bytes, bytes]]
    quality: float

    def matches(self, other: _Range) -> bool:
        kind = other.name.split("/")[0]
        return self.name in ("*/*", f"{kind}/*", other.name) and self.parameters <= other.parameters

    @property
    def precision(self) -> tuple[int, int]:
        return -self.name.count("*"), len(self.parameters)


def choose(accept: str, offered: Sequence[str]) -> str:
    """Pick the offered media type that the client likes best; the client's order, then ours, breaks ties.

    A range must match with all of its parameters; the most precise range that matches a type decides for it.

    Raises:
        NotAcceptable: none is liked; the message lists what is offered.
    """
    ranges = [_parse(part) for part in accept.split(",") if part.strip()] or [_parse("*/*")]
    liked = [(*_liking(_offer(media_type), ranges), media_type) for media_type in offered]
    quality, _, best = max(liked, key=lambda like: like[:2])
    if quality <= 0:
        raise NotAcceptable(f"Accept is {accept!r}; offered are {', '.join(offered)}")
    return best


def _liking(media_type: _Range, ranges: Sequence[_Range]) -> tuple[float, int]:
    matching = [
        (liked.precision, -place, liked.quality)
        for place, liked in enumerate(ranges)
        if liked.matches(media_type)
    ]
    if not matching:
        return 0.0, 0
    _, place, quality = max(matching)
    return quality, place


@cache
def _offer(media_type: str) -> _Range:
    return _parse(media_type)


def _parse(text: str) -> _Range:
    name, options = parse_options_header(text.strip())
    parameters = {key.lower(): value.lower() for key, value in options.items()}
    quality = _quality(parameters.pop(b"q", b"1"))
    return _Range(name.strip().lower().decode("latin-1"), frozenset(parameters.items()), quality)


def _quality(text: bytes) -> float:
    try:
        quality = float(text)
    except ValueError:
        return 0.0
    return quality if 0 <= quality <= 1 else 0.0
