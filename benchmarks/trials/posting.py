"""Mutants as parts of requests to a real server, over several connections."""

from __future__ import annotations

import io
import json
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import httpx
import numpy as np

from stereomend.api.server import server_process
from stereomend.settings import load_settings
from trials.mutations import Mutant, make_mutant
from trials.originals import FORMATS, Array, Format
from trials.processes import descendants, forget_highest, is_worker, memory_mb

CONNECTIONS = 4
LONGEST_S = 1.0
MOST_PIXELS = 1_000_000
"""A pair whose mutants lie alike is refined at the size they promise; this keeps it under a second."""
EXPECTED = frozenset((200, 413, 415, 422))
"""What the answer to a damaged file may be."""

_PRESETS = ("paper", "released", "robust")
_ACCEPTED = ("image/png", "application/x-npy", "application/zip", "image/tiff")


@dataclass
class Posted:
    """What came of the mutants of one format; numbers name mutants."""

    requests: int = 0
    statuses: Counter[int] = field(default_factory=Counter)
    problems: Counter[str] = field(default_factory=Counter)
    faults: dict[int, str] = field(default_factory=dict)
    longest_s: float = 0.0
    """From the call of the client to the answer, the wait behind other connections' requests included."""
    slowest: int = -1
    grown_mb: dict[str, float] = field(default_factory=dict)
    """`server` and `worker`: highest resident memory less that before the first request."""
    workers_replaced: int = 0

    def as_json(self) -> dict[str, Any]:
        """Plain data."""
        return dict(vars(self))


class Target(NamedTuple):
    """A server under trial."""

    url: str
    pid: int

    def workers(self) -> list[int]:
        """The worker processes that are there now."""
        return [pid for pid in descendants(self.pid) if is_worker(pid)]


@contextmanager
def target() -> Iterator[Target]:
    """A server of its own, with the default limits but for `MOST_PIXELS`."""
    with TemporaryDirectory() as folder:
        settings = load_settings(port=0, max_pixels=MOST_PIXELS, data_dir=Path(folder))
        with server_process(settings) as server:
            yield Target(server.url, server.process.pid)


def post_mutants(server: Target, format: Format, numbers: range, seed: int) -> Posted:
    """Post these mutants and compare the server's processes before and after."""
    found = Posted()
    workers = server.workers()
    watched = {"server": [pid for pid in _all(server) if pid not in workers], "worker": workers}
    before = {name: _highest(pids, anew=True) for name, pids in watched.items()}
    with _connections(server.url) as client, ThreadPoolExecutor(CONNECTIONS) as threads:

        def post(number: int) -> _Reply:
            return _post(client, format, number, seed)

        for number, reply in zip(numbers, list(threads.map(post, numbers)), strict=True):
            # Another connection's request, or another program, may have had the processor.
            alone = [post(number) for _ in range(2 * (reply.seconds > LONGEST_S))]
            _count(found, number, min((reply, *alone), key=lambda one: one.seconds))
    found.grown_mb = {name: _highest(pids) - before[name] for name, pids in watched.items()}
    found.workers_replaced = len(set(workers) - set(server.workers()))
    return found


class _Reply(NamedTuple):
    status: int
    """0: the connection broke."""
    problem: str
    seconds: float


def _connections(url: str) -> httpx.Client:
    limits = httpx.Limits(max_connections=CONNECTIONS, max_keepalive_connections=CONNECTIONS)
    return httpx.Client(base_url=url, timeout=60, limits=limits)


def _post(client: httpx.Client, format: Format, number: int, seed: int) -> _Reply:
    made = make_mutant(format, number, seed)
    files = {name: (name, data) for name, data in _files(format, made, number).items()}
    accept = {"Accept": _ACCEPTED[number % len(_ACCEPTED)]}
    began = time.perf_counter()
    try:
        answer = client.post("/v1/refine", files=files, headers=accept)
    except httpx.TransportError as error:
        return _Reply(0, repr(error), time.perf_counter() - began)
    elapsed = time.perf_counter() - began
    return _Reply(answer.status_code, answer.text if answer.is_error else "", elapsed)


def _files(format: Format, made: Mutant, number: int) -> dict[str, bytes]:
    """The mutant as left, right or both, as the map or the mask; all else is sound and of its size."""
    sound = _npy((np.arange(np.prod(made.shape)) % 251).astype(np.uint8).reshape(made.shape))
    files = {"left": sound, "right": sound, "disparity": _npy(np.full(made.shape, 0.5, np.float32))}
    params: dict[str, Any] = {"preset": _PRESETS[number % 3], "gdr": {"warps": 1}}
    if format.part == "map":
        files["disparity"] = made.data
        params |= {"disparity_scale": 16} if number % 2 else {}
    elif format.part == "mask":
        files["mask"] = made.data
    elif number // 3 % 3 < 2:
        files[("left", "right")[number // 3 % 3]] = made.data
    else:
        # No map of the size that both promise is at hand.
        files = {"left": made.data, "right": made.data}
        params["initial"] = ("zero", "sgbm")[number % 2]
    return files | {"params": json.dumps(params).encode()}


def _count(found: Posted, number: int, reply: _Reply) -> None:
    found.requests += 1
    found.statuses[reply.status] += 1
    if reply.status not in EXPECTED:
        found.faults[number] = f"{reply.status}: {reply.problem[:300]}"
    elif reply.problem:
        found.problems[json.loads(reply.problem)["type"]] += 1
    if reply.seconds > found.longest_s:
        found.longest_s, found.slowest = reply.seconds, number
    if reply.seconds > LONGEST_S:
        found.faults[number] = f"{reply.status} after {reply.seconds:.2f} s"


def _all(server: Target) -> list[int]:
    return [server.pid, *descendants(server.pid)]


def _highest(pids: Sequence[int], anew: bool = False) -> float:
    for pid in pids:
        if anew:
            forget_highest(pid)
    return sum(memory_mb(pid, "VmHWM") for pid in pids)


def _npy(array: Array) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def warm_up(server: Target) -> None:
    """Let every format and preset come once, so that libraries have taken what they keep."""
    for format in FORMATS:
        post_mutants(server, format, range(-9, 0), 0)
