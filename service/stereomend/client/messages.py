"""What goes to the server and how its answers are read, whoever does the waiting."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import httpx
import numpy as np
import numpy.typing as npt

from stereomend.disparity import DisparityMap, RefinementResult, as_mask
from stereomend.errors import InternalError, InvalidParameter, NotReady, StereomendError, error_from_slug

File: TypeAlias = npt.NDArray[Any] | str | Path | bytes
"""An array, the path of a file, or the bytes of one."""

Request: TypeAlias = dict[str, Any]
"""Arguments of the `request` and `stream` of httpx."""

ZIP = "application/zip"
PRESETS = "/v1/presets"
ALIVE = "/livez"
READY = "/readyz"

_PROBLEM = "application/problem+json"


@dataclass(frozen=True)
class Inputs:
    """What a refinement is made from."""

    left: File
    right: File
    disparity: File | None
    mask: File | None
    params: Mapping[str, object]


@dataclass(frozen=True)
class Connection:
    """Where a server is, and how to talk to it."""

    base_url: str
    api_key: str | None
    timeout: float

    def options(self) -> dict[str, Any]:
        """Arguments of `httpx.Client` and `httpx.AsyncClient`."""
        return {
            "base_url": self.base_url,
            "headers": {"Authorization": f"Bearer {self.api_key}"} if self.api_key else {},
            # No limit on waiting for one of this client's own connections: the server has not been asked yet.
            "timeout": httpx.Timeout(self.timeout, connect=min(self.timeout, 10.0), pool=None),
        }


def refinement(inputs: Inputs, accept: str = ZIP) -> Request:
    """Ask for a refinement (raises OSError if a file cannot be read)."""
    files = {"left": _encoded(inputs.left), "right": _encoded(inputs.right)}
    if inputs.disparity is not None:
        files["disparity"] = _encoded(_as_disparity(inputs.disparity))
    if inputs.mask is not None:
        files["mask"] = _encoded(_as_mask(inputs.mask))
    given = {name: value for name, value in inputs.params.items() if value is not None}
    parts: dict[str, tuple[str | None, bytes]] = {name: (name, file) for name, file in files.items()}
    parts["params"] = (None, json.dumps(given).encode())
    body, headers = _form(parts)
    return {"method": "POST", "url": "/v1/refine", "content": body, "headers": {"Accept": accept} | headers}


def document(url: str) -> Request:
    """Ask for a JSON document."""
    return {"method": "GET", "url": url, "headers": {"Accept": "application/json"}}


def check_whole(params: Mapping[str, object]) -> None:
    """Refuse to leave arrays out of a result (raises InvalidParameter)."""
    if params.get("outputs") is not None:
        raise InvalidParameter("outputs: a result of the SDK always has all arrays")


@contextmanager
def reaching(base_url: httpx.URL) -> Iterator[None]:
    """Turn failures of the connection into NotReady."""
    try:
        yield
    except httpx.TimeoutException as error:
        raise NotReady(f"{base_url} did not answer in time ({type(error).__name__})") from error
    except httpx.TransportError as error:
        raise NotReady(f"{base_url} cannot be reached: {error}") from error


def accepted(response: httpx.Response) -> httpx.Response:
    """The response itself, once its body is read (raises the error that it tells of)."""
    if not (response.is_success or response.status_code == httpx.codes.NOT_MODIFIED):
        raise _error(response)
    return response


def is_stream(response: httpx.Response) -> bool:
    """Whether events come, so that the body has no end yet."""
    kind = response.headers.get("Content-Type", "").partition(";")[0]
    return response.status_code == httpx.codes.OK and kind == "text/event-stream"


def check_empty(response: httpx.Response) -> None:
    """Accept, where events were asked for, that there are no more (raises the error that it tells of)."""
    if accepted(response).status_code != httpx.codes.NO_CONTENT:
        raise InternalError("the server's answer is no stream of events")


def read_result(response: httpx.Response) -> RefinementResult:
    """Read a zip and the timings beside it (raises InternalError if it is none of ours)."""
    try:
        with np.load(io.BytesIO(response.content), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        meta = json.loads(str(arrays.pop("meta")))
        timings = _timings(response.headers.get("server-timing", ""))
        return RefinementResult(**arrays, timings=timings, meta=meta)
    except (ValueError, OSError, KeyError, TypeError) as error:
        raise InternalError(f"the server's answer is no result: {error}") from error


def read_document(response: httpx.Response) -> dict[str, Any]:
    """Read a JSON document."""
    content: dict[str, Any] = response.json()
    return content


def _form(parts: Mapping[str, tuple[str | None, bytes]]) -> tuple[bytes, dict[str, str]]:
    """The body that holds `parts`, and its headers."""
    # As a whole: sent piece by piece, a millisecond of a refinement goes by.
    form = httpx.Request("POST", "http://form", files=parts)
    return form.read(), {"Content-Type": form.headers["Content-Type"]}


def _encoded(file: File) -> bytes:
    if isinstance(file, bytes):
        return file
    if isinstance(file, str | Path):
        return Path(file).read_bytes()
    stream = io.BytesIO()
    np.save(stream, np.asarray(file), allow_pickle=False)
    return stream.getvalue()


def _as_disparity(file: File) -> File:
    # An array is in pixels whatever its type; the server would ask for the scale of an integer map.
    return file if isinstance(file, str | Path | bytes) else DisparityMap.from_array(np.asarray(file)).values


def _as_mask(file: File) -> File:
    return file if isinstance(file, str | Path | bytes) else as_mask(np.asarray(file))


def _timings(header: str) -> dict[str, float]:
    pairs = (entry.strip().split(";dur=") for entry in header.split(",") if ";dur=" in entry)
    return {name: float(duration) for name, duration in pairs}


def _error(response: httpx.Response) -> StereomendError:
    problem = _problem(response)
    slug = str(problem.get("type", "")).rpartition("/")[2]
    detail = (
        problem.get("detail") or f"{response.url} answered {response.status_code} {response.reason_phrase}"
    )
    error = error_from_slug(slug, detail)
    error.status = response.status_code
    error.request_id = problem.get("request_id") or response.headers.get("X-Request-ID")
    error.retry_after = _seconds(response.headers.get("Retry-After", ""))
    return error


def _problem(response: httpx.Response) -> dict[str, Any]:
    if response.headers.get("Content-Type", "").partition(";")[0] != _PROBLEM:
        return {}
    try:
        content = response.json()
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}


def _seconds(text: str) -> float | None:
    try:
        seconds = float(text)
    except ValueError:
        return None
    return seconds if math.isfinite(seconds) and seconds >= 0 else None
