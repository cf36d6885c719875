"""The SDK against real servers: one suite for both clients."""

import asyncio
import os
import signal
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, HTTPServer

import httpx
import numpy as np
import pytest

from stereomend import AsyncClient, Client, refine
from stereomend.errors import (
    AccessDenied,
    InvalidParameter,
    NotReady,
    QueueFull,
    ShapeMismatch,
    StereomendError,
    WorkerCrashed,
)

QUICK = {"gdr": {"warps": 1, "levels": 1}}
ENDLESS = {"gdr": {"warps": 1000, "iterations": 1000, "levels": 1}, "processing_scale": 1.0}


class Awaited:
    """`AsyncClient` with the interface of `Client`."""

    def __init__(self, *args, **kwargs):
        self.client = AsyncClient(*args, **kwargs)

    def __enter__(self):
        self.runner = asyncio.Runner()
        self.runner.run(self.client.__aenter__())
        return self

    def __exit__(self, *error):
        self.runner.run(self.client.__aexit__(*error))
        self.runner.close()

    def __getattr__(self, verb):
        async def call(*args, **kwargs):
            return await getattr(self.client, verb)(*args, **kwargs)

        return lambda *args, **kwargs: self.runner.run(call(*args, **kwargs))


@pytest.fixture(params=[Client, Awaited], ids=["sync", "async"])
def connect(request):
    return request.param


@pytest.fixture
def client(server, connect):
    with connect(server.url) as client:
        yield client


def test_a_server_and_this_process_give_the_same_result(client, scene, stages):
    remote = client.refine(scene.left, scene.right, scene.disparity, **QUICK)
    local = refine(scene.left, scene.right, scene.disparity, backend="reference", **QUICK)
    for name in ("disparity", "confidence", "provenance", "input_confidence"):
        np.testing.assert_array_equal(getattr(remote, name), getattr(local, name))
    assert remote.quality == local.quality
    assert list(remote.timings) == stages


def test_files_are_sent_as_they_are(client, scene, tmp_path):
    for name, content in scene.files.items():
        (tmp_path / name).write_bytes(content)
    from_files = client.refine(tmp_path / "left", str(tmp_path / "right"), tmp_path / "disparity", **QUICK)
    from_arrays = client.refine(scene.left, scene.right, scene.disparity, **QUICK)
    np.testing.assert_array_equal(from_files.disparity, from_arrays.disparity)


def test_a_mask_goes_along_as_array_and_as_file(client, scene, tmp_path):
    mask = np.indices(scene.disparity.shape).sum(axis=0) > 20
    np.save(tmp_path / "mask.npy", mask)
    local = refine(scene.left, scene.right, scene.disparity, mask=mask, backend="reference", **QUICK)
    for sent in (mask, mask.astype(np.int32) * 9, tmp_path / "mask.npy"):
        remote = client.refine(scene.left, scene.right, scene.disparity, mask=sent, **QUICK)
        for name in ("disparity", "confidence", "provenance", "input_confidence"):
            np.testing.assert_array_equal(getattr(remote, name), getattr(local, name))


def test_a_calibration_brings_depth(client, scene):
    remote = client.refine(
        scene.left, scene.right, scene.disparity, focal_px=60, baseline_mm=4, doffs=1, **QUICK
    )
    np.testing.assert_allclose(remote.depth_mm, 240 / (remote.disparity.astype(float) + 1), rtol=1e-6)
    assert (remote.calibration.cx, remote.calibration.cy) == (31.5, 23.5)


def test_an_array_of_integers_is_in_pixels(client, scene):
    integers = scene.disparity.astype(np.int64)
    remote = client.refine(scene.left, scene.right, integers, **QUICK)
    local = refine(scene.left, scene.right, integers, backend="reference", **QUICK)
    np.testing.assert_array_equal(remote.disparity, local.disparity)


def test_any_media_type_comes_as_the_bytes_that_http_gives(client, server, scene):
    body, headers = client.refine_bytes(
        scene.left, scene.right, scene.disparity, {"stages": ["ldr"]}, "application/x-npy"
    )
    files = {**scene.files, "params": (None, '{"stages": ["ldr"]}')}
    raw = httpx.post(f"{server.url}/v1/refine", files=files, headers={"Accept": "application/x-npy"})
    assert body == raw.content
    assert headers["Content-Type"] == "application/x-npy"
    assert "server-timing" in headers


def test_parameters_that_are_none_are_not_sent(client, scene):
    result = client.refine(scene.left, scene.right, preset=None, initial=None, stages=["ldr"])
    assert result.meta["initial"] == "sgbm"


def test_a_problem_becomes_the_exception_of_its_name(client, scene):
    with pytest.raises(ShapeMismatch, match="64 x 47") as raised:
        client.refine(scene.left, scene.right[1:], scene.disparity)
    assert raised.value.status == 422
    assert len(raised.value.request_id) == 32
    with pytest.raises(InvalidParameter, match="wraps"):
        client.refine(scene.left, scene.right, gdr={"wraps": 1})
    with pytest.raises(InvalidParameter, match="outputs"):
        client.refine(scene.left, scene.right, outputs=["confidence"])


def test_a_missing_key_is_told(serving, scene, connect):
    with serving(api_keys="secret") as server:
        with connect(server.url) as client, pytest.raises(AccessDenied, match="API key"):
            client.presets()
        with connect(server.url, api_key="secret") as client:
            assert client.presets()["default"]


def test_health_and_readiness_are_told(client):
    assert client.health() == {"status": "alive"}
    assert client.ready()["backend"] == "reference"


def test_a_server_that_is_not_there_is_named(scene, connect):
    with (
        connect("http://127.0.0.1:9") as client,
        pytest.raises(NotReady, match=r"http://127\.0\.0\.1:9.* cannot be reached"),
    ):
        client.refine(scene.left, scene.right)


def test_an_answer_that_takes_too_long_is_not_waited_for(server, scene, connect):
    with connect(server.url, timeout=0.2) as client, pytest.raises(NotReady, match="in time"):
        client.refine(scene.left, scene.right, scene.disparity, **ENDLESS | {"gdr": {"warps": 1000}})


def test_a_full_queue_is_waited_for(serving, scene, connect):
    with serving(max_queued_jobs=1, work_limit_s=2) as server:
        first = occupy(server, scene)
        with connect(server.url) as client:
            client.refine(scene.left, scene.right, scene.disparity, **QUICK)
        first.join()


def test_patience_ends(serving, scene, connect):
    with serving(max_queued_jobs=1, work_limit_s=30) as server:
        occupy(server, scene)
        with connect(server.url) as client, pytest.raises(QueueFull) as raised:
            client.refine(scene.left, scene.right, scene.disparity, **QUICK)
        assert raised.value.status == 429
        assert raised.value.retry_after >= 1


def test_a_request_that_kills_its_worker_is_repeated_once(serving, scene, eventually, connect):
    with serving() as server:
        raised = []

        def ask():
            with connect(server.url) as client, pytest.raises(WorkerCrashed) as error:
                client.refine(scene.left, scene.right, scene.disparity, **ENDLESS)
            raised.append(error.value)

        asking = threading.Thread(target=ask)
        asking.start()
        for attempt in (1, 2):
            eventually(lambda ready=attempt: server.log.read_text().count("a worker is ready") == ready)
            idle = server.cpu()
            eventually(lambda idle=idle: server.cpu() > idle + 0.3)
            os.kill(server.workers()[0], signal.SIGKILL)
        asking.join(20)
        assert raised[0].status == 503
    assert server.log.read_text().count("POST /v1/refine 503") == 2


def occupy(server, scene):
    def ask():
        with Client(server.url) as client, pytest.raises(StereomendError):
            client.refine(scene.left, scene.right, scene.disparity, **ENDLESS)

    idle = server.cpu()
    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    while server.cpu() < idle + 0.3:
        time.sleep(0.02)
    return thread


def test_many_refinements_at_once_each_get_their_own_answer(server, scene):
    """Each asks for a map of its own; more at a time than there are connections."""
    levels = np.linspace(1, 9, 120)

    async def ask():
        async with AsyncClient(server.url) as client:
            asked = (
                client.refine(
                    scene.left[:8, :12],
                    scene.right[:8, :12],
                    np.full((8, 12), level),
                    stages=["ldr"],
                    ldr={"min_confidence": 0, "specular": "off"},
                )
                for level in levels
            )
            return await asyncio.gather(*asked)

    for level, result in zip(levels, asyncio.run(ask()), strict=True):
        assert (result.disparity == np.float32(level)).all()


def test_a_refinement_that_is_cancelled_is_not_waited_for(serving, scene, eventually):
    async def ask_and_leave(server):
        idle = server.cpu()
        async with AsyncClient(server.url) as client:
            asking = asyncio.create_task(client.refine(scene.left, scene.right, scene.disparity, **ENDLESS))
            while server.cpu() < idle + 0.3:
                await asyncio.sleep(0.02)
            asking.cancel()
            with pytest.raises(asyncio.CancelledError):
                await asking

    with serving(work_limit_s=2) as server:
        asyncio.run(ask_and_leave(server))
        eventually(lambda: "POST /v1/refine 499" in server.log.read_text())


class Stranger(BaseHTTPRequestHandler):
    """Some other server, as a proxy or a router's login page."""

    status = 200

    def do_GET(self):
        self.send_response(self.status)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<h1>hello</h1>")

    def do_POST(self):
        self.rfile.read(int(self.headers["Content-Length"]))
        self.do_GET()

    def log_message(self, *args):
        pass


@pytest.fixture
def stranger():
    with HTTPServer(("127.0.0.1", 0), Stranger) as other:
        thread = threading.Thread(target=other.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{other.server_port}"
        other.shutdown()
        thread.join()


def test_an_answer_of_another_server_is_an_error_of_ours(stranger, scene, monkeypatch, connect):
    with connect(stranger) as client:
        with pytest.raises(StereomendError, match="no result"):
            client.refine(scene.left, scene.right)
        monkeypatch.setattr(Stranger, "status", 502)
        with pytest.raises(StereomendError, match="502"):
            client.refine(scene.left, scene.right)


def test_the_sdk_is_light():
    heavy = "{'fastapi', 'starlette', 'cv2', 'stereomend._native', 'stereomend.refinement'}"
    program = f"import sys; from stereomend import Client; assert not {heavy} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", program], check=True)
