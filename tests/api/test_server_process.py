"""What the server does when its processes die, hang or are told to stop."""

import os
import signal
import subprocess
import sys
import time

import httpx
import numpy as np
import pytest

from stereomend.api.server import background_server
from stereomend.errors import NotReady
from stereomend.settings import load_settings

QUICK = {"gdr": {"warps": 1, "levels": 1}}
ENDLESS = {"gdr": {"warps": 1000, "iterations": 1000, "levels": 1}, "processing_scale": 1.0}


def test_only_the_request_of_a_killed_worker_fails(serving, post, occupy, in_background, is_problem):
    with serving() as server:
        (worker,) = server.workers()
        running = occupy(server)
        waiting = in_background(post, server, params=QUICK)
        os.kill(worker, signal.SIGKILL)
        is_problem(running(), 503, "worker-crashed")
        assert int(running().headers["Retry-After"]) >= 1
        assert waiting().status_code == 200
        assert post(server, params=QUICK).status_code == 200
        assert server.workers() != [worker]


def test_an_idle_worker_that_is_killed_is_replaced(serving, post, eventually):
    with serving() as server:
        (worker,) = server.workers()
        os.kill(worker, signal.SIGKILL)
        assert post(server, params=QUICK).status_code == 200
        eventually(lambda: httpx.get(f"{server.url}/readyz").status_code == 200)


def test_a_server_that_stood_still_gives_up_no_worker(serving, submit, eventually):
    with serving(lease_s=1) as server:
        job = submit(server, params=ENDLESS).json()
        look = f"{server.url}/v1/jobs/{job['id']}"
        eventually(lambda: httpx.get(look).json()["state"] == "running")
        api, workers = server.api, server.workers()
        os.kill(api, signal.SIGSTOP)
        time.sleep(3)
        os.kill(api, signal.SIGCONT)
        time.sleep(1)
        assert httpx.get(look).json()["attempt"] == 1
        assert server.workers() == workers
        httpx.delete(look)


def test_the_server_answers_while_a_refinement_runs(serving, occupy):
    with serving(work_limit_s=2) as server:
        reply = occupy(server)
        slowest = 0.0
        with httpx.Client(base_url=server.url) as client:
            for _ in range(50):
                began = time.monotonic()
                assert client.get("/livez").json() == {"status": "alive"}
                slowest = max(slowest, time.monotonic() - began)
                time.sleep(0.02)
        assert slowest < 1
        assert reply().status_code == 503


@pytest.mark.parametrize("backend", ["reference", "native"])
def test_no_worker_outlives_a_killed_server(serving, eventually, alive, occupy, backend):
    if backend == "native":
        pytest.importorskip("stereomend._native")
    with serving(workers=2, backend=backend) as server:
        workers = server.workers()
        assert len(workers) == 2
        occupy(server)
        os.kill(server.pid, signal.SIGKILL)
        eventually(lambda: not any(map(alive, workers)))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_to_the_whole_group_ends_the_server_quietly(tmp_path, number):
    log = tmp_path / "log"
    settings = {"PORT": "0", "BACKEND": "reference", "DATA_DIR": str(tmp_path / "data")}
    environment = os.environ | {f"STEREOMEND_{name}": value for name, value in settings.items()}
    with log.open("w") as stream:
        command = [sys.executable, "-m", "stereomend", "serve"]
        process = subprocess.Popen(
            command, env=environment, stdout=subprocess.PIPE, stderr=stream, start_new_session=True
        )
    with process:
        assert process.stdout.readline().startswith(b"Stereomend listens on http://127.0.0.1:")
        os.killpg(process.pid, number)
        assert process.wait(20) == 0
    assert "Traceback" not in log.read_text()


def test_a_stopping_server_lets_what_runs_finish(serving, occupy):
    brief = ENDLESS | {"gdr": ENDLESS["gdr"] | {"warps": 10}}
    with serving() as server:
        reply = occupy(server, brief)
        server.process.terminate()
        assert reply().status_code == 200
        assert server.process.wait(20) == 0


def test_a_stopping_server_does_not_wait_for_ever(serving, occupy):
    with serving() as server:
        reply = occupy(server)
        server.process.terminate()
        assert reply().status_code == 503
        assert server.process.wait(20) == 0


def test_a_client_that_leaves_gives_up_its_place(serving, post, in_background, eventually, occupy):
    with serving(max_queued_jobs=2, work_limit_s=5) as server:
        running = occupy(server)
        with pytest.raises(httpx.ReadTimeout):
            post(server, params=ENDLESS, timeout=0.5)
        eventually(lambda: " 499 " in server.log.read_text())
        waiting = in_background(post, server)
        assert running().status_code == 503
        assert waiting().status_code == 200


def test_work_that_needs_too_much_memory_is_refused(serving, post, as_npy, is_problem):
    noise = as_npy(np.random.default_rng(0).integers(0, 255, (3000, 4000), np.uint8))
    with serving(work_limit_mb=256) as server:
        response = post(server, params={"processing_scale": 1.0}, left=noise, right=noise, disparity=None)
        is_problem(response, 503, "work-limit-exceeded")
        assert post(server, params=QUICK).status_code == 200


def test_an_address_in_use_is_told_in_one_line(server):
    environment = os.environ | {"STEREOMEND_PORT": server.url.rpartition(":")[2]}
    ended = subprocess.run(
        [sys.executable, "-m", "stereomend", "serve"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1
    assert "in use" in ended.stderr


def test_a_background_server_that_cannot_start_is_an_error(server):
    port = int(server.url.rpartition(":")[2])
    with pytest.raises(NotReady, match="exit code 2"), background_server(load_settings(port=port)):
        pass


def test_readiness_says_what_computes_and_why(server):
    ready = httpx.get(f"{server.url}/readyz").json()
    assert ready["status"] == "ready"
    assert ready["backend"] == "reference"
    assert ready["reason"]
    assert ready["workers_up"] == ready["workers"] == 1
