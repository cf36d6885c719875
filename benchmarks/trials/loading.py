"""Clients that keep a server busy, and one that measures what the server itself takes."""

from __future__ import annotations

import json
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from threading import Event, Lock, Thread
from typing import Any, NamedTuple
from uuid import uuid4

import cv2
import httpx
import numpy as np

from stereomend.bench.cases import WxH, broken_phantom
from stereomend.jobs.task import TIMINGS
from trials.processes import descendants, is_worker, memory_mb

STAGES = tuple(name for name in TIMINGS if name not in ("queue", "total"))
"""Of `Server-Timing`: what is done to pixels and files, and is not the server's own."""
_SAMPLE_S = 1.0
_SETTLED = 0.25
"""So much of the run is left out of the slope of memory: pools and caches fill."""


class Done(NamedTuple):
    """One request or job that was accepted and has its result."""

    durable: bool
    seconds: float
    """From the call that was accepted to the result."""
    work_s: float
    """`total` less `queue` of its timings."""


@dataclass
class Load:
    """What clients saw."""

    done: list[Done] = field(default_factory=list)
    statuses: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    memory_mb: dict[str, list[float]] = field(default_factory=lambda: {"server": [], "workers": []})
    """Resident, each second."""
    lock: Lock = field(default_factory=Lock)

    def slope_mb_per_minute(self, name: str) -> float:
        """Of the line through the samples after the first quarter."""
        samples = np.array(self.memory_mb[name])
        settled = samples[int(_SETTLED * len(samples)) :]
        return float(np.polyfit(np.arange(len(settled)), settled, 1)[0] * 60 / _SAMPLE_S)


@cache
def form(size: WxH, preset: str) -> dict[str, tuple[str | None, bytes]]:
    """A request with PNG files."""
    phantom, disparity = broken_phantom(size)
    levels = np.rint(disparity * 256).astype(np.uint16)
    pair = (phantom.pair.left, phantom.pair.right)
    colour = [image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR) for image in pair]
    files = dict(zip(("left", "right", "disparity"), (*colour, levels), strict=True))
    parts: dict[str, tuple[str | None, bytes]] = {
        name: (f"{name}.png", bytes(cv2.imencode(".png", image)[1])) for name, image in files.items()
    }
    return parts | {"params": (None, json.dumps({"preset": preset}).encode())}


def run_clients(url: str, pid: int, clients: int, seconds: float, ask: Mapping[str, Any]) -> Load:
    """Half of the clients wait for each answer, half submit jobs and wait for the result, for so long."""
    load, over = Load(), Event()
    work = [_refine if number % 2 else _submit for number in range(clients)]
    threads = [Thread(target=_repeat, args=(one, url, ask, load, over), daemon=True) for one in work]
    for thread in threads:
        thread.start()
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        _sample(pid, load)
        time.sleep(_SAMPLE_S)
    over.set()
    for thread in threads:
        thread.join()
    return load


def _sample(pid: int, load: Load) -> None:
    found = [pid, *descendants(pid)]
    for name, wanted in (("server", False), ("workers", True)):
        load.memory_mb[name].append(sum(memory_mb(one, "VmRSS") for one in found if is_worker(one) is wanted))


def _repeat(
    one: Callable[..., Done | None], url: str, ask: Mapping[str, Any], load: Load, over: Event
) -> None:
    with httpx.Client(base_url=url, timeout=120) as http:
        while not over.is_set():
            try:
                done = one(http, ask, load, over)
            except (httpx.HTTPError, LookupError) as error:
                load.faults.append(repr(error))
                return
            if done is not None:
                load.done.append(done)


def _refine(http: httpx.Client, ask: Mapping[str, Any], load: Load, over: Event) -> Done | None:
    found = _asked(load, over, lambda: http.post("/v1/refine", files=ask))
    if found is None:
        return None
    answer, began = found
    timings = server_timing(answer.headers["Server-Timing"])
    return Done(False, time.perf_counter() - began, (timings["total"] - timings["queue"]) / 1e3)


def _submit(http: httpx.Client, ask: Mapping[str, Any], load: Load, over: Event) -> Done | None:
    key = {"Idempotency-Key": uuid4().hex}
    found = _asked(load, over, lambda: http.post("/v1/jobs", files=ask, headers=key))
    if found is None:
        return None
    accepted, began = found
    job = accepted.json()
    path = f"/v1/jobs/{job['id']}"
    while job["state"] in ("queued", "running"):
        job = http.get(path, headers={"Prefer": "wait=10"}).raise_for_status().json()
    if job["state"] != "succeeded":
        raise LookupError(f"a job ended {job['state']}: {job['error']}")
    http.get(f"{path}/result").raise_for_status()
    timings = job["timings_ms"]
    return Done(True, time.perf_counter() - began, (timings["total"] - timings["queue"]) / 1e3)


def _asked(load: Load, over: Event, ask: Callable[[], httpx.Response]) -> tuple[httpx.Response, float] | None:
    """Ask again after each 429 when it says; also returns when what was accepted was asked.

    None: the time was over before there was room.
    """
    while not over.is_set():
        began = time.perf_counter()
        answer = ask()
        with load.lock:
            load.statuses[f"{answer.request.url.path} {answer.status_code}"] += 1
        if answer.status_code != 429:
            if answer.is_error:
                raise LookupError(f"{answer.status_code} {answer.text[:300]}")
            return answer, began
        over.wait(float(answer.headers["Retry-After"]))
    return None


class Own(NamedTuple):
    """What one request took, in ms."""

    wait: float
    """From the last byte of the body sent to the first byte of the answer received."""
    stages: float
    """`STAGES` of its `Server-Timing`."""


def measure_own(url: str, ask: Mapping[str, Any], requests: int) -> list[Own]:
    """One request after another over one kept connection, nothing else asked of the server."""
    request = _encoded(url, ask)
    host, port = httpx.URL(url).host, httpx.URL(url).port
    with socket.create_connection((host, port)) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return [_own(connection, request) for _ in range(requests)]


def _own(connection: socket.socket, request: bytes) -> Own:
    connection.sendall(request)
    sent = time.perf_counter()
    received = connection.recv(1)
    wait = 1e3 * (time.perf_counter() - sent)
    head, body = received, b""
    while b"\r\n\r\n" not in head:
        head += connection.recv(65536)
    head, _, body = head.partition(b"\r\n\r\n")
    headers = dict(_header_lines(head))
    left = int(headers["content-length"]) - len(body)
    while left > 0:
        left -= len(connection.recv(min(left, 1 << 20)))
    if not head.startswith(b"HTTP/1.1 200"):
        raise LookupError(head[:300].decode())
    timings = server_timing(headers["server-timing"])
    return Own(wait, sum(timings[name] for name in STAGES))


def _header_lines(head: bytes) -> Iterator[tuple[str, str]]:
    for line in head.decode("latin-1").split("\r\n")[1:]:
        name, _, value = line.partition(":")
        yield name.strip().lower(), value.strip()


def _encoded(url: str, ask: Mapping[str, Any]) -> bytes:
    made = httpx.Request("POST", f"{url}/v1/refine", files=ask, headers={"Accept": "image/png"})
    body = made.read()
    lines = [f"{name}: {value}" for name, value in made.headers.items()]
    return "\r\n".join(["POST /v1/refine HTTP/1.1", *lines, "", ""]).encode() + body


def server_timing(header: str) -> dict[str, float]:
    """Milliseconds by name."""
    entries = (entry.strip().partition(";dur=") for entry in header.split(","))
    return {name: float(duration) for name, _, duration in entries}
