"""The multipart body of a refinement, read into memory and never to disk."""

from __future__ import annotations

import json
from collections.abc import AsyncGenerator, Mapping, Sequence
from typing import Any

from python_multipart.multipart import parse_options_header
from starlette.requests import Request

from stereomend.api.multipart import Part, read_form
from stereomend.errors import BodyTooLarge, InvalidParameter, MalformedRequest, UnknownFormat

FILES = ("left", "right", "disparity", "mask")
PARAMS = "params"
_OPTIONAL = ("disparity", "mask", PARAMS)
_LONGEST_PARAMS = 1 << 16


def check_headers(request: Request, most: int) -> None:
    """Refuse by its headers what need not be read; `most` in bytes.

    Raises:
        UnknownFormat: the body is not multipart/form-data.
        BodyTooLarge: the announced body is longer than `most`.
    """
    content_type, _ = parse_options_header(request.headers.get("content-type", ""))
    if content_type.lower() != b"multipart/form-data":
        raise UnknownFormat(
            f"the body is {content_type.decode('latin-1') or 'untyped'}; expected multipart/form-data"
        )
    announced = request.headers.get("content-length", "0")
    if announced.isdecimal() and int(announced) > most:
        raise _too_large(most)


async def read_parts(request: Request, most: int) -> Mapping[str, bytes]:
    """Read the parts of a body of at most `most` bytes, chunked bodies included.

    Raises:
        BodyTooLarge: the body is longer than `most`; the rest is not read.
        MalformedRequest: it is no multipart, or a part is missing, doubled, unknown or no file.
    """
    parts = await read_form(request.headers.get("content-type", ""), _bounded(request, most))
    _check_names([part.name for part in parts])
    return {part.name: _content(part) for part in parts}


def read_params(text: bytes) -> Mapping[str, Any]:
    """Read the JSON object of the part `params` (raises InvalidParameter, saying where it is wrong)."""
    if len(text) > _LONGEST_PARAMS:
        raise InvalidParameter(f"params has {len(text)} bytes; expected at most {_LONGEST_PARAMS}")
    try:
        params = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InvalidParameter(f"params is not JSON: {error}") from error
    if not isinstance(params, dict):
        raise InvalidParameter(f"params is a JSON {type(params).__name__}; expected an object")
    return params


async def _bounded(request: Request, most: int) -> AsyncGenerator[bytes, None]:
    size = 0
    async for chunk in request.stream():
        size += len(chunk)
        if size > most:
            raise _too_large(most)
        yield chunk


def _check_names(names: Sequence[str]) -> None:
    known = (*FILES, PARAMS)
    for name in names:
        if name not in known:
            raise MalformedRequest(f"part {name!r} is unknown; expected {', '.join(known)}")
        if names.count(name) > 1:
            raise MalformedRequest(f"part {name!r} came {names.count(name)} times; expected once")
    for name in FILES:
        if name not in names and name not in _OPTIONAL:
            raise MalformedRequest(
                f"part {name!r} is missing; expected left, right and optionally {', '.join(_OPTIONAL)}"
            )


def _content(part: Part) -> bytes:
    if part.name != PARAMS and not part.is_file:
        raise MalformedRequest(
            f"part {part.name!r} is text; expected a file, that is, a part with a filename"
        )
    return part.content


def _too_large(most: int) -> BodyTooLarge:
    return BodyTooLarge(f"the body is larger than the {most / (1 << 20):g} MiB that the server takes")
