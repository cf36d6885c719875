"""The SDK: refinements by a server, over HTTP."""

from __future__ import annotations

import io
import json
import math
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeAlias

import httpx
import numpy as np
import numpy.typing as npt

from stereomend.disparity import DisparityMap, RefinementResult
from stereomend.errors import (
    InternalError,
    InvalidParameter,
    NotReady,
    QueueFull,
    StereomendError,
    WorkerCrashed,
    error_from_slug,
)

File: TypeAlias = npt.NDArray[Any] | str | Path | bytes
"""An array, the path of a file, or the bytes of one."""

_Parts: TypeAlias = dict[str, tuple[str | None, bytes]]

ATTEMPTS = 4
"""How often a refinement is asked for at most, while the server says that it may do later."""
LONGEST_WAIT_S = 30.0
"""A server that asks for more patience than this is not waited for."""

_PROBLEM = "application/problem+json"


class Client:
    """Asks a server at `base_url`; a context manager, since it keeps connections open.

    Args:
        base_url: such as `http://127.0.0.1:8000`.
        api_key: needed where the server has keys.
        timeout: seconds to wait for one answer.
    """

    def __init__(self, base_url: str, api_key: str | None = None, timeout: float = 330.0) -> None:
        headers = {"Authorization": f"Bearer {api_key}"} if api_key else {}
        limits = httpx.Timeout(timeout, connect=min(timeout, 10.0))
        self._http = httpx.Client(base_url=base_url, headers=headers, timeout=limits)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close all connections."""
        self._http.close()

    def refine(
        self, left: File, right: File, disparity: File | None = None, **params: object
    ) -> RefinementResult:
        """Refine a disparity map and wait for the result.

        Args:
            left: uint8 or uint16, (H, W) or (H, W, 3) RGB, rectified; or a file in a format that is read.
            right: as `left`.
            disparity: (H, W) px, of the left image; not finite or <= 0 is unknown. None: matched by SGBM.
            **params: `preset`, `stages`, `initial`, `ldr={...}`, `gdr={...}` and the others of `presets()`;
                those that are None count as not given.

        Returns:
            The maps, each (H, W); `timings` in ms with the keys of `Server-Timing`.

        Raises:
            InputError: the server refuses the input; the subclass says why.
            AccessDenied: the API key is missing or wrong.
            Unavailable: the server cannot do it now, after `ATTEMPTS` attempts where a repetition is safe.
        """
        if params.get("outputs") is not None:
            raise InvalidParameter("outputs: a result of the SDK always has all arrays")
        body, headers = self.refine_bytes(left, right, disparity, params)
        return _result(body, headers)

    def refine_bytes(
        self,
        left: File,
        right: File,
        disparity: File | None = None,
        params: Mapping[str, object] | None = None,
        accept: str = "application/zip",
    ) -> tuple[bytes, Mapping[str, str]]:
        """Refine, and give the answer's body and headers as they came, in the media type `accept`.

        Arguments and errors as `refine`.
        """
        files = {"left": _encoded(left), "right": _encoded(right)}
        if disparity is not None:
            files["disparity"] = _encoded(_as_disparity(disparity))
        given = {name: value for name, value in (params or {}).items() if value is not None}
        parts: _Parts = {name: (name, content) for name, content in files.items()}
        parts["params"] = (None, json.dumps(given).encode())
        response = self._refine_patiently(parts, accept)
        return response.content, response.headers

    def presets(self) -> dict[str, Any]:
        """The presets, `{default, presets: {name: {description, params}}, schema}`; raises as `refine`."""
        presets: dict[str, Any] = self._send("GET", "/v1/presets").json()
        return presets

    def health(self) -> dict[str, Any]:
        """Whether the server answers (raises NotReady if it cannot be reached)."""
        health: dict[str, Any] = self._send("GET", "/livez").json()
        return health

    def ready(self) -> dict[str, Any]:
        """Which backend computes on the server, and why (raises NotReady while no worker is up)."""
        ready: dict[str, Any] = self._send("GET", "/readyz").json()
        return ready

    def _refine_patiently(self, parts: _Parts, accept: str) -> httpx.Response:
        crashes = 0
        for attempt in range(1, ATTEMPTS + 1):
            try:
                return self._send("POST", "/v1/refine", parts, accept)
            except (QueueFull, NotReady, WorkerCrashed) as error:
                crashes += isinstance(error, WorkerCrashed)
                wait_s = error.retry_after
                # Without a status nobody answered.
                if error.status is None or crashes > 1 or attempt == ATTEMPTS:
                    raise
                if wait_s is None or wait_s > LONGEST_WAIT_S:
                    raise
            time.sleep(wait_s)
        raise AssertionError("the last attempt returns or raises")

    def _send(
        self, method: str, path: str, parts: _Parts | None = None, accept: str = "application/json"
    ) -> httpx.Response:
        try:
            response = self._http.request(method, path, files=parts, headers={"Accept": accept})
        except httpx.TimeoutException as error:
            raise NotReady(
                f"{self._http.base_url} did not answer in time ({type(error).__name__})"
            ) from error
        except httpx.TransportError as error:
            raise NotReady(f"{self._http.base_url} cannot be reached: {error}") from error
        if not response.is_success:
            raise _error(response)
        return response


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


def _result(body: bytes, headers: Mapping[str, str]) -> RefinementResult:
    try:
        with np.load(io.BytesIO(body), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        meta = json.loads(str(arrays.pop("meta")))
        return RefinementResult(**arrays, timings=_timings(headers.get("server-timing", "")), meta=meta)
    except (ValueError, OSError, KeyError, TypeError) as error:
        raise InternalError(f"the server's answer is no result: {error}") from error


def _timings(header: str) -> dict[str, float]:
    pairs = (entry.strip().split(";dur=") for entry in header.split(",") if ";dur=" in entry)
    return {name: float(duration) for name, duration in pairs}


def _error(response: httpx.Response) -> StereomendError:
    document = _problem(response)
    slug = str(document.get("type", "")).rpartition("/")[2]
    detail = (
        document.get("detail") or f"{response.url} answered {response.status_code} {response.reason_phrase}"
    )
    error = error_from_slug(slug, detail)
    error.status = response.status_code
    error.request_id = document.get("request_id") or response.headers.get("X-Request-ID")
    error.retry_after = _seconds(response.headers.get("Retry-After", ""))
    return error


def _problem(response: httpx.Response) -> dict[str, Any]:
    if response.headers.get("Content-Type", "").partition(";")[0] != _PROBLEM:
        return {}
    try:
        document = response.json()
    except ValueError:
        return {}
    return document if isinstance(document, dict) else {}


def _seconds(text: str) -> float | None:
    try:
        seconds = float(text)
    except ValueError:
        return None
    return seconds if math.isfinite(seconds) and seconds >= 0 else None
