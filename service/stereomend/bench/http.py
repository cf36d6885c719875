"""What a client of a server waits for besides LDR and GDR."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from stereomend.api.server import passing_server
from stereomend.bench.cases import WxH, broken_phantom
from stereomend.client import Client
from stereomend.disparity import FloatMap, Image
from stereomend.jobs.task import TIMINGS
from stereomend.opencv import cv2

_WARM_UP = 3

Times = dict[str, float]
"""Milliseconds of one request by the keys of `Server-Timing`, and `client`: from call to return."""


@dataclass(frozen=True)
class Percentiles:
    """Milliseconds over all requests."""

    p50: float
    p90: float


@dataclass(frozen=True)
class HttpTimes:
    """Requests one after another over one kept connection; PNG files in, 16-bit PNG out."""

    input: WxH
    preset: str
    requests: int
    sent_bytes: int
    """Of the three files of a request."""
    received_bytes: int
    client: Percentiles
    """From the call until the answer is there."""
    stages: Percentiles
    """LDR + GDR of the same requests."""
    besides: Percentiles
    """`client` - `stages`, request by request."""
    parts: dict[str, Percentiles]
    """What `besides` is made of."""


def time_http(size: WxH, preset: str, requests: int, threads: int = 0) -> HttpTimes:
    """Run a server and be its client (raises NotReady if it does not start)."""
    files = _files(size)
    with passing_server(threads=threads) as url, Client(url) as client:
        answers = [_request(client, files, preset) for _ in range(_WARM_UP + requests)]
    times = [times for times, _ in answers[_WARM_UP:]]
    return HttpTimes(
        input=size,
        preset=preset,
        requests=requests,
        sent_bytes=sum(map(len, files)),
        received_bytes=answers[-1][1],
        client=_percentiles([one["client"] for one in times]),
        stages=_percentiles([one["ldr"] + one["gdr"] for one in times]),
        besides=_percentiles([one["client"] - one["ldr"] - one["gdr"] for one in times]),
        parts=_parts(times),
    )


def _parts(times: Sequence[Times]) -> dict[str, Percentiles]:
    known = [name for name in TIMINGS if name not in ("ldr", "gdr", "total")]
    parts = {name: _percentiles([one[name] for one in times]) for name in known}
    inside = [one["total"] - sum(one[name] for name in TIMINGS if name != "total") for one in times]
    outside = [one["client"] - one["total"] for one in times]
    return parts | {"inside": _percentiles(inside), "outside": _percentiles(outside)}


def _files(size: WxH) -> tuple[bytes, bytes, bytes]:
    phantom, disparity = broken_phantom(size)
    sixteen_bit = np.rint(disparity * 256).astype(np.uint16)
    return _png(phantom.pair.left), _png(phantom.pair.right), _png(sixteen_bit)


def _png(image: Image | FloatMap) -> bytes:
    stored = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    return bytes(cv2.imencode(".png", stored)[1])


def _request(client: Client, files: tuple[bytes, bytes, bytes], preset: str) -> tuple[Times, int]:
    began = perf_counter()
    body, headers = client.refine_bytes(*files, {"preset": preset}, accept="image/png")
    elapsed = 1e3 * (perf_counter() - began)
    return _server_timing(headers) | {"client": elapsed}, len(body)


def _server_timing(headers: Mapping[str, str]) -> Times:
    entries = (entry.strip().partition(";dur=") for entry in headers["server-timing"].split(","))
    return {name: float(duration) for name, _, duration in entries}


def _percentiles(times_ms: Sequence[float]) -> Percentiles:
    p50, p90 = np.percentile(times_ms, (50, 90))
    return Percentiles(float(p50), float(p90))
