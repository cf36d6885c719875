"""A GPU that fails under a running server, seen over HTTP; the emulated device breaks down on demand."""

import io
import json
import re
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime

import httpx
import numpy as np
import pytest

from stereomend.refinement import refine

BRIEF = {"preset": "released", "gdr": {"warps": 1, "levels": 1}}
ON_GPU = ["h2d", "d2h"]


@pytest.fixture
def gpu_server(faulty_device, serving, monkeypatch):
    """Start a server on the emulated device: `with gpu_server(FAKE_CUDA_...="...") as server`."""

    def start(**environment):
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        return serving(backend="cuda")

    return start


@pytest.fixture
def post(scene):
    def send(server):
        files = {name: (name, content) for name, content in scene.files.items()}
        files["params"] = (None, json.dumps(BRIEF))
        accept = {"Accept": "application/x-npy"}
        return httpx.post(f"{server.url}/v1/refine", files=files, headers=accept, timeout=60)

    return send


def meta(response):
    assert response.status_code == 200, response.text[:300]
    return json.loads(response.headers["Stereomend-Meta"])


def timings(response):
    return dict(entry.split(";dur=") for entry in response.headers["Server-Timing"].split(", "))


def readiness(server):
    return httpx.get(f"{server.url}/readyz").status_code


def check_fault(response, code, name):
    assert response.status_code == 503
    assert response.headers["Content-Type"] == "application/problem+json"
    assert int(response.headers["Retry-After"]) >= 1
    problem = response.json()
    assert problem["type"] == "/problems/device-fault"
    assert f"CUDA error {code} ({name})" in problem["detail"]


@pytest.mark.parametrize(
    ("code", "name"), [(700, "illegal address"), (719, "launch failed"), (214, "uncorrectable ECC error")]
)
def test_a_fault_costs_one_request_and_the_worker_and_those_that_wait_are_answered_by_the_next(
    gpu_server, plant, post, eventually, code, name
):
    with gpu_server() as server:
        (worker,) = server.workers()
        before = post(server)
        assert (meta(before)["backend"], meta(before)["device"]) == ("cuda", "Fake CUDA device")
        plant(f"launch 1:{code}")
        with ThreadPoolExecutor(4) as pool:
            sent = [pool.submit(post, server) for _ in range(4)]
            # Until the next worker is up, a second later, nobody is ready.
            eventually(lambda: readiness(server) == 503)
            answers = [reply.result() for reply in sent]
        (failed,) = [answer for answer in answers if answer.status_code != 200]
        check_fault(failed, code, name)
        assert all(answer.content == before.content for answer in answers if answer is not failed)
        assert readiness(server) == 200
        assert server.workers() != [worker]
        assert "a worker ended with exit code 86" in server.log.read_text()


def test_a_device_that_fails_each_time_is_tried_again_after_longer_and_longer_pauses(gpu_server, post):
    with gpu_server(FAKE_CUDA_FAIL_LAUNCH="0:719") as server:
        for _ in range(4):
            check_fault(post(server), 719, "launch failed")
    log = server.log.read_text()
    lives = re.findall(r"^(.{23}) \S+ \S+ a worker (is ready|ended with exit code 86)", log, re.M)
    times = [(datetime.strptime(time, "%Y-%m-%d %H:%M:%S,%f"), what == "is ready") for time, what in lives]
    begins, ends = ([time for time, up in times if up == wanted] for wanted in (True, False))
    pauses = [(begin - end).total_seconds() for end, begin in zip(ends, begins[1:], strict=False)]
    assert len(pauses) == 3
    for pause, least in zip(pauses, (0.2, 0.4, 0.8), strict=True):
        assert pause >= least


def test_without_memory_on_the_device_the_answer_is_the_cpus_and_says_so(gpu_server, plant, post, scene):
    with gpu_server() as server:
        workers = server.workers()
        plant("allocation 1")
        without, after = post(server), post(server)
        assert server.workers() == workers
        assert readiness(server) == 200
    assert meta(without)["backend"] == "native"
    assert "device-out-of-memory" in meta(without)["quality"]["warnings"]
    assert not set(ON_GPU) & set(timings(without))
    expected = refine(scene.left, scene.right, scene.disparity, backend="native", **BRIEF).disparity
    assert np.load(io.BytesIO(without.content)).tobytes() == expected.tobytes()
    assert meta(after)["backend"] == "cuda"
    assert "device-out-of-memory" not in meta(after)["quality"]["warnings"]


def test_server_timing_has_the_copies(gpu_server, post):
    with gpu_server() as server:
        found = timings(post(server))
    assert list(found)[-2:] == ON_GPU
    assert all(float(found[name]) > 0 for name in ON_GPU)
    assert sum(float(found[name]) for name in ON_GPU) < float(found["gdr"])
