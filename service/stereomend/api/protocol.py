"""HTTP/1.1 of a connection: uvicorn's, but what is no request gets a problem document, an endless one too.

The application never hears of these, so the line of the log, the figures and the headers of the answer are
made here.
"""

from __future__ import annotations

import json
from uuid import uuid4

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from stereomend.api.envelope import REQUEST_ID, SAFE_HEADERS, log_access
from stereomend.api.problems import MEDIA_TYPE, problem_document
from stereomend.errors import MalformedRequest
from stereomend.jobs.meters import Meters

LONGEST_HEAD = 1 << 16
"""Bytes of a request line with its headers, of trailers, or of what comes with the size of a chunk."""


class BoundedProtocol(HttpToolsProtocol):
    """Ends connections whose heads or trailers do not end, or bodies after their answer.

    Other bounds see only bodies that somebody reads.
    """

    most_unread: int
    """Bytes of a body that may follow its answer, for clients that send all before they read."""
    meters: Meters
    _unread = 0
    _unheard = 0
    """Bytes since the parser last told of something; it gathers heads and trailers of any length."""

    def data_received(self, data: bytes) -> None:
        """Parse what has come."""
        self._unheard += len(data)
        super().data_received(data)
        if self._unheard > LONGEST_HEAD and not self.transport.is_closing():
            self.send_400_response(f"the head of the request is longer than {LONGEST_HEAD} bytes")

    def on_headers_complete(self) -> None:
        """The request line and the headers are there."""
        self._unheard = self._unread = 0
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """A piece of the body is there."""
        self._unheard = 0
        if self.cycle.response_complete:
            self._unread += len(body)
            if self._unread > self.most_unread:
                self.transport.close()
            return
        if not self.cycle.body:
            # What is added to empty bytes is not copied; to uvicorn's bytearray it is, and out of it again.
            self.cycle.body = b""  # type: ignore[assignment]
        super().on_body(body)

    def on_message_complete(self) -> None:
        """The request is there as a whole."""
        self._unheard = 0
        super().on_message_complete()

    def send_400_response(self, msg: str) -> None:
        """Say what is wrong with the request and end the connection."""
        problem = problem_document(MalformedRequest(msg), uuid4().hex)
        log_access(_access(problem["request_id"]), {"problem": MalformedRequest.slug})
        self.meters.count_request(("-", "-", 400), 0.0)
        self.meters.count_refusal(MalformedRequest.slug)
        self.transport.write(self._answer(problem["request_id"], json.dumps(problem).encode()))
        self.transport.close()

    def _answer(self, request_id: str, body: bytes) -> bytes:
        ours = SAFE_HEADERS | {
            REQUEST_ID: request_id,
            "Content-Type": MEDIA_TYPE,
            "Content-Length": str(len(body)),
            "Connection": "close",
        }
        headers = [(name.encode(), value.encode()) for name, value in ours.items()]
        lines = (name + b": " + value for name, value in (*headers, *self.server_state.default_headers))
        return b"\r\n".join((b"HTTP/1.1 400 Bad Request", *lines, b"", body))


def protocol_with(most_unread: int, meters: Meters) -> type[BoundedProtocol]:
    """The protocol of a server whose bodies have at most so many bytes."""
    return type("Protocol", (BoundedProtocol,), {"most_unread": most_unread, "meters": meters})


def _access(request_id: str) -> dict[str, object]:
    return dict.fromkeys(("key", "method", "route", "job"), "-") | {
        "status": 400,
        "ms": 0.0,
        "request_id": request_id,
    }
