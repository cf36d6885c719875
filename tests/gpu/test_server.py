"""A server on a real GPU, seen over HTTP."""

import io
import json

import httpx
import numpy as np
import pytest
from problems import near

from stereomend.refinement import refine

pytestmark = pytest.mark.usefixtures("gpu")


@pytest.fixture
def kept_kernels(tmp_path, monkeypatch):
    """Where the server keeps its compiled kernels."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "stereomend" / "kernels"


@pytest.fixture
def post(scene):
    def send(server):
        files = {name: (name, content) for name, content in scene.files.items()}
        accept = {"Accept": "application/x-npy"}
        return httpx.post(f"{server.url}/v1/refine", files=files, headers=accept, timeout=60)

    return send


def test_the_answer_is_the_gpus_and_says_so(serving, post, scene):
    with serving(backend="auto") as server:
        answer = post(server)
    meta, timings = json.loads(answer.headers["Stereomend-Meta"]), answer.headers["Server-Timing"]
    expected = refine(scene.left, scene.right, scene.disparity, backend="native").disparity
    found = np.load(io.BytesIO(answer.content))
    assert (answer.status_code, meta["backend"]) == (200, "cuda")
    assert near(found, expected)
    assert {"h2d", "d2h"} <= {entry.partition(";")[0] for entry in timings.split(", ")}


def test_a_fault_costs_one_request_and_the_next_worker_answers(serving, post, kept_kernels, eventually):
    """The first worker loads kernels that trap; the next one good ones."""
    with serving(backend="cuda") as server:
        expected = post(server)
    (kept,) = kept_kernels.glob("*.ptx")
    good = kept.read_bytes()
    name, _, body = good.partition(b".entry halve(")
    kept.write_bytes(name + b".entry halve(" + body.replace(b"\n{\n", b"\n{\ntrap;\n", 1))
    with serving(backend="cuda") as server:
        kept.write_bytes(good)
        (worker,) = server.workers()
        failed = post(server)
        eventually(lambda: httpx.get(f"{server.url}/readyz").status_code == 200)
        again = post(server)
        assert server.workers() != [worker]
        assert "a worker ended with exit code 86" in server.log.read_text()
    assert (failed.status_code, failed.json()["type"]) == (503, "/problems/device-fault")
    assert "CUDA error" in failed.json()["detail"]
    assert (again.status_code, again.content) == (200, expected.content)
