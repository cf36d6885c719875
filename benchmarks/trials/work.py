"""Small jobs whose right results are known, and clients that insist until they have them."""

from __future__ import annotations

import io
import json
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from threading import Event, Lock, Thread
from typing import Any, NamedTuple

import httpx
import numpy as np

from stereomend.codec import encode_map
from stereomend.jobs.task import Files, refine_files
from stereomend.phantom import break_disparity, make_phantom
from stereomend.refinement import parse_params, select_backend

NPY_TYPE = "application/x-npy"
WIDTH, HEIGHT = 96, 64
_SCENES = 3
_PARAMS: tuple[Mapping[str, Any], ...] = (
    {"preset": "released", "gdr": {"warps": 40}},
    {"preset": "paper"},
    {"preset": "robust"},
    {"preset": "released", "stages": ["ldr"]},
)
_PATIENCE_S = 120.0
"""How long a client asks for the same thing before it gives up."""
_RETRIED = frozenset((409, 429, 500, 502, 503, 504, 507))


class Kind(NamedTuple):
    """One of the jobs that clients submit."""

    files: Files
    params: Mapping[str, Any]
    expected: bytes
    """The NPY file that comes of it."""

    @property
    def form(self) -> dict[str, tuple[str | None, bytes]]:
        """The parts of its body."""
        parts = {"left": self.files.left, "right": self.files.right, "disparity": self.files.disparity or b""}
        form: dict[str, tuple[str | None, bytes]] = {name: (name, data) for name, data in parts.items()}
        return form | {"params": (None, json.dumps(self.params).encode())}


@cache
def kinds() -> tuple[Kind, ...]:
    """Every scene with every set of parameters, refined in this process."""
    backend = select_backend("native", 1)
    found = []
    for seed in range(_SCENES):
        phantom = make_phantom(seed, WIDTH, HEIGHT)
        arrays = (phantom.pair.left, phantom.pair.right, break_disparity(phantom, seed).values)
        files = Files(*(npy(array) for array in arrays))
        for params in _PARAMS:
            result = refine_files(files, parse_params(params), backend, WIDTH * HEIGHT).result
            found.append(Kind(files, params, encode_map(result.disparity, NPY_TYPE)))
    return tuple(found)


def npy(array: Any) -> bytes:
    """An NPY file."""
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


@dataclass
class Told:
    """All that clients were told, and what is wrong with it."""

    ids: dict[str, str] = field(default_factory=dict)
    """From idempotency key to the id of its job."""
    kinds: dict[str, int] = field(default_factory=dict)
    """From idempotency key to the kind of job."""
    results: dict[str, bytes] = field(default_factory=dict)
    """From idempotency key to the result that was fetched."""
    answers: dict[int, int] = field(default_factory=dict)
    """How often each status came; 0: the connection broke."""
    faults: list[str] = field(default_factory=list)
    lock: Lock = field(default_factory=Lock)

    def count(self, status: int) -> None:
        """Count an answer."""
        with self.lock:
            self.answers[status] = self.answers.get(status, 0) + 1

    def expect(self, holds: bool, otherwise: str) -> None:
        """Take note of what must not be, if it is so."""
        if not holds:
            self.blame(otherwise)

    def blame(self, fault: str) -> None:
        """Take note of what must not be."""
        with self.lock:
            self.faults.append(fault)


class Client:
    """Submits jobs one after another, at most `ahead` without their result, until it is told to stop."""

    def __init__(self, url: str, name: str, told: Told, ahead: int = 3) -> None:
        kinds()  # while nothing waits for it
        self._http = httpx.Client(base_url=url, timeout=30)
        self._name = name
        self._told = told
        self._ahead = ahead
        self._random = np.random.default_rng(int(name.rsplit("-", maxsplit=1)[-1]))
        self._stop = Event()
        self._thread = Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Begin to submit."""
        self._thread.start()

    def finish(self) -> None:
        """Submit no more, and wait for all results."""
        self._stop.set()
        self._thread.join()
        self._http.close()

    def _run(self) -> None:
        waiting: list[str] = []
        number = 0
        try:
            while not self._stop.is_set() or waiting:
                while len(waiting) < self._ahead and not self._stop.is_set():
                    waiting.append(
                        self.submit(f"{self._name}-{number}", int(self._random.integers(len(kinds()))))
                    )
                    number += 1
                if waiting:
                    self.collect(waiting.pop(0))
        except Exception as error:
            self._told.blame(f"client {self._name} gave up: {error!r}")

    def submit(self, key: str, kind: int) -> str:
        """Submit until it is accepted, and now and then once more."""
        self._told.kinds[key] = kind
        for _ in range(2 if self._random.random() < 0.2 else 1):
            answer = self._ask("POST", "/v1/jobs", kinds()[kind].form, {"Idempotency-Key": key})
            document = answer.json()
            known = self._told.ids.setdefault(key, document["id"])
            if known != document["id"]:
                self._told.blame(f"{key} became two jobs, {known} and {document['id']}")
        return key

    def collect(self, key: str) -> None:
        """Wait until a job has ended and fetch its result."""
        path = f"/v1/jobs/{self._told.ids[key]}"
        deadline = time.monotonic() + _PATIENCE_S
        while True:
            job = self._ask("GET", path, headers={"Prefer": "wait=2"}).json()
            if job["state"] not in ("queued", "running"):
                break
            if time.monotonic() > deadline:
                self._told.blame(f"{key} is still {job['state']} after {_PATIENCE_S:g} s")
                return
        if job["state"] != "succeeded":
            self._told.blame(f"{key} ended {job['state']}: {job['error']}")
            return
        result = self._ask("GET", f"{path}/result", headers={"Accept": NPY_TYPE}).content
        self._told.results[key] = result
        if result != kinds()[self._told.kinds[key]].expected:
            self._told.blame(f"{key} has another result than it should, of {len(result)} bytes")

    def _ask(self, method: str, path: str, form: Any = None, headers: Any = None) -> httpx.Response:
        """Ask until there is an answer that is not to be asked for again."""
        deadline = time.monotonic() + _PATIENCE_S
        while True:
            try:
                answer = self._http.request(method, path, files=form, headers=headers)
            except httpx.TransportError:
                self._told.count(0)
                pause, status = 0.05, 0
            else:
                self._told.count(answer.status_code)
                status = answer.status_code
                if status == 500:
                    self._told.blame(f"{method} {path}: 500 {answer.text[:300]}")
                if status not in _RETRIED:
                    break
                pause = min(float(answer.headers.get("Retry-After", 0.1)), 1.0)
            if time.monotonic() > deadline:
                raise TimeoutError(f"{method} {path} had no answer but {status}")
            time.sleep(pause)
        if answer.is_error:
            raise LookupError(f"{method} {path}: {status} {answer.text[:300]}")
        return answer


def look_again(url: str, told: Told, attempts: Counter[int]) -> None:
    """Every id of a 202 is known, ended well, gives the same result again, and there is no other job."""
    with httpx.Client(base_url=url, timeout=30) as http:
        listed = {job["id"]: job for job in _pages(http)}
        ids = set(told.ids.values())
        told.expect(len(ids) == len(told.ids), "two idempotency keys have one job")
        told.expect(set(listed) == ids, f"jobs nobody was told of: {set(listed) ^ ids}")
        for key, id in told.ids.items():
            job = listed.get(id, {"state": "unknown", "attempt": 0})
            attempts[job["attempt"]] += 1
            told.expect(job["state"] == "succeeded", f"{key} ({id}) is {job['state']} in the end")
            again = http.get(f"/v1/jobs/{id}/result", headers={"Accept": NPY_TYPE})
            told.expect(again.content == told.results.get(key), f"{key} ({id}) has another result now")


def _pages(http: httpx.Client) -> Iterator[dict[str, Any]]:
    cursor: dict[str, str] = {}
    while True:
        page = http.get("/v1/jobs", params={"limit": "200", **cursor}).raise_for_status().json()
        yield from page["jobs"]
        if page["next_cursor"] is None:
            return
        cursor = {"cursor": page["next_cursor"]}
