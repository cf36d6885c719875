"""The SDK against real servers."""

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

from stereomend import Client, refine
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


@pytest.fixture
def client(server):
    with Client(server.url) as client:
        yield client


def test_a_server_and_this_process_give_the_same_result(client, scene):
    remote = client.refine(scene.left, scene.right, scene.disparity, **QUICK)
    local = refine(scene.left, scene.right, scene.disparity, backend="reference", **QUICK)
    for name in ("disparity", "confidence", "provenance", "input_confidence"):
        np.testing.assert_array_equal(getattr(remote, name), getattr(local, name))
    assert remote.quality == local.quality
    assert list(remote.timings) == ["queue", "decode", "initial", "ldr", "gdr", "encode", "total"]


def test_files_are_sent_as_they_are(client, scene, tmp_path):
    for name, content in scene.files.items():
        (tmp_path / name).write_bytes(content)
    from_files = client.refine(tmp_path / "left", str(tmp_path / "right"), tmp_path / "disparity", **QUICK)
    from_arrays = client.refine(scene.left, scene.right, scene.disparity, **QUICK)
    np.testing.assert_array_equal(from_files.disparity, from_arrays.disparity)


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


def test_a_missing_key_is_told(serving, scene):
    with serving(api_keys="secret") as server:
        with Client(server.url) as client, pytest.raises(AccessDenied, match="API key"):
            client.presets()
        with Client(server.url, api_key="secret") as client:
            assert client.presets()["default"]


def test_health_and_readiness_are_told(client):
    assert client.health() == {"status": "alive"}
    assert client.ready()["backend"] == "reference"


def test_a_server_that_is_not_there_is_named(scene):
    with (
        Client("http://127.0.0.1:9") as client,
        pytest.raises(NotReady, match=r"http://127\.0\.0\.1:9.* cannot be reached"),
    ):
        client.refine(scene.left, scene.right)


def test_an_answer_that_takes_too_long_is_not_waited_for(server, scene):
    with Client(server.url, timeout=0.2) as client, pytest.raises(NotReady, match="in time"):
        client.refine(scene.left, scene.right, scene.disparity, **ENDLESS | {"gdr": {"warps": 1000}})


def test_a_full_queue_is_waited_for(serving, scene):
    with serving(max_queued_jobs=1, work_limit_s=2) as server:
        first = occupy(server, scene)
        with Client(server.url) as client:
            client.refine(scene.left, scene.right, scene.disparity, **QUICK)
        first.join()


def test_patience_ends(serving, scene):
    with serving(max_queued_jobs=1, work_limit_s=30) as server:
        occupy(server, scene)
        with Client(server.url) as client, pytest.raises(QueueFull) as raised:
            client.refine(scene.left, scene.right, scene.disparity, **QUICK)
        assert raised.value.status == 429
        assert raised.value.retry_after >= 1


def test_a_request_that_kills_its_worker_is_repeated_once(serving, scene, eventually):
    with serving() as server:
        raised = []

        def ask():
            with Client(server.url) as client, pytest.raises(WorkerCrashed) as error:
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


def test_an_answer_of_another_server_is_an_error_of_ours(stranger, scene, monkeypatch):
    with Client(stranger) as client:
        with pytest.raises(StereomendError, match="no result"):
            client.refine(scene.left, scene.right)
        monkeypatch.setattr(Stranger, "status", 502)
        with pytest.raises(StereomendError, match="502"):
            client.refine(scene.left, scene.right)


def test_the_sdk_is_light():
    heavy = "{'fastapi', 'starlette', 'cv2', 'stereomend._native', 'stereomend.refinement'}"
    program = f"import sys; from stereomend import Client; assert not {heavy} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", program], check=True)
