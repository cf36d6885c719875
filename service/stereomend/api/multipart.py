"""multipart/form-data, read into memory part by part as it comes, and never to disk."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import NamedTuple

from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from stereomend.errors import MalformedRequest

_MOST_PARTS = 32


class Part(NamedTuple):
    """One part of a form."""

    name: str
    is_file: bool
    """It has a filename."""
    content: bytes


async def read_form(content_type: str, body: AsyncIterator[bytes]) -> list[Part]:
    """Read the parts of a form in their order; one that the body does not end is left out.

    Raises:
        MalformedRequest: the body is no multipart, has too many parts or one without a name.
    """
    form = _Form(content_type)
    try:
        async for chunk in body:
            form.parser.write(chunk)
        form.parser.finalize()
    except FormParserError as error:
        raise MalformedRequest("Invalid multipart data.") from error
    except (KeyError, ValueError) as error:
        raise MalformedRequest("the headers of a part cannot be read") from error
    return form.parts


class _Form:
    """The parser's callbacks, and what they gather."""

    def __init__(self, content_type: str) -> None:
        boundary = parse_options_header(content_type)[1].get(b"boundary")
        if boundary is None:
            raise MalformedRequest("Missing boundary in multipart.")
        self.parts: list[Part] = []
        self._disposition = self._field = self._value = b""
        self._pieces: list[memoryview] = []
        self.parser = MultipartParser(
            boundary,
            {
                "on_part_begin": self._begin,
                "on_header_field": self._on_field,
                "on_header_value": self._on_value,
                "on_header_end": self._end_header,
                "on_part_data": self._on_data,
                "on_part_end": self._end,
            },
        )

    def _begin(self) -> None:
        if len(self.parts) == _MOST_PARTS:
            raise MalformedRequest(f"the body has more than {_MOST_PARTS} parts")
        self._disposition = self._field = self._value = b""
        self._pieces = []

    def _on_field(self, data: bytes, start: int, end: int) -> None:
        self._field += data[start:end]

    def _on_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def _end_header(self) -> None:
        if self._field.lower() == b"content-disposition":
            self._disposition = self._value
        self._field = self._value = b""

    def _on_data(self, data: bytes, start: int, end: int) -> None:
        # Copied once, when the part is whole.
        self._pieces.append(memoryview(data)[start:end])

    def _end(self) -> None:
        options = parse_options_header(self._disposition)[1]
        if b"name" not in options:
            raise MalformedRequest('The Content-Disposition header field "name" must be provided.')
        self.parts.append(Part(_text(options[b"name"]), b"filename" in options, b"".join(self._pieces)))


def _text(name: bytes) -> str:
    try:
        return name.decode()
    except UnicodeDecodeError:
        return name.decode("latin-1")
