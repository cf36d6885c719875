"""Requests as a client in any language would send them."""

import json
import socket
import threading

import httpx
import pytest

QUICK = {"gdr": {"warps": 1, "levels": 1}}
ENDLESS = {"gdr": {"warps": 1000, "iterations": 1000, "levels": 1}, "processing_scale": 1.0}


@pytest.fixture
def post(scene):
    """POST a pair: `post(server, accept=..., params=..., left=..., disparity=None)`."""

    def send(
        server, accept="application/x-npy", params=None, headers=None, path="/v1/refine", timeout=60, **files
    ):
        files = {
            name: (name, content) for name, content in (scene.files | files).items() if content is not None
        }
        if isinstance(params, bytes):
            files["params"] = ("params.json", params)
        elif params is not None:
            files["params"] = (None, params if isinstance(params, str) else json.dumps(params))
        headers = {"Accept": accept} | (headers or {})
        return httpx.post(server.url + path, files=files, headers=headers, timeout=timeout)

    return send


@pytest.fixture
def connect():
    """Open a bare connection to a server, for bytes that no client would send."""

    def open_one(server):
        host, port = server.url.removeprefix("http://").split(":")
        return socket.create_connection((host, int(port)), timeout=10)

    return open_one


@pytest.fixture
def in_background():
    """Call in a thread: `reply = in_background(post, server)`, later `reply()` for what came of it."""
    threads = []

    def start(call, *args, **kwargs):
        returned = []

        def run():
            try:
                returned.append(call(*args, **kwargs))
            except httpx.TransportError as error:
                returned.append(error)

        thread = threading.Thread(target=run)
        threads.append(thread)
        thread.start()

        def reply():
            thread.join(60)
            return returned[0]

        return reply

    yield start
    for thread in threads:
        thread.join(60)


@pytest.fixture
def occupy(post, in_background, eventually):
    """Keep a worker busy: `reply = occupy(server)` once it computes, later `reply()` for the answer."""

    def start(server, params=ENDLESS):
        idle = server.cpu()
        reply = in_background(post, server, params=params)
        eventually(lambda: server.cpu() > idle + 0.3)
        return reply

    return start


@pytest.fixture
def is_problem():
    """Check that an answer is a problem document, and give it."""

    def check(response, status, slug):
        assert response.status_code == status, response.text[:300] if response.is_error else "no error"
        assert response.headers["Content-Type"] == "application/problem+json"
        document = response.json()
        assert document["type"] == f"/problems/{slug}"
        assert document["status"] == status
        assert document["title"]
        assert document["detail"]
        assert document["request_id"] == response.headers["X-Request-ID"]
        return document

    return check


@pytest.fixture
def submit(post):
    """POST /v1/jobs: `submit(server, key="frame-17", params=..., left=...)` gives the answer."""

    def send(server, key=None, params=QUICK, headers=None, **files):
        headers = (headers or {}) | ({} if key is None else {"Idempotency-Key": key})
        return post(server, accept="*/*", params=params, headers=headers, path="/v1/jobs", **files)

    return send


@pytest.fixture
def finished():
    """Wait until a submitted job has ended, and give it: `finished(server, submit(server))`."""

    def wait(server, submitted, headers=None):
        assert submitted.status_code == 202, submitted.text
        url, headers = server.url + submitted.headers["Location"], headers or {}
        job = submitted.json()
        while "cancel" in job["links"]:
            known = {"Prefer": "wait=20", "If-None-Match": f'"{job["version"]}"'}
            answer = httpx.get(url, headers=headers | known, timeout=60)
            job = answer.json() if answer.status_code == 200 else job
        return job

    return wait
