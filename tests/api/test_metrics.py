"""Figures for Prometheus, compared with what was done to a real server."""

import json
import os
import shutil
import signal
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families

from stereomend.errors import DeviceFault, WorkerCrashed
from stereomend.jobs.blobs import BlobStore, pack
from stereomend.jobs.folder import open_ledger
from stereomend.jobs.meters import Figures, Meters
from stereomend.jobs.records import NewJob, Room, inputs_blob
from stereomend.jobs.task import Files
from stereomend.refinement import parse_params

QUICK = {"gdr": {"warps": 1, "levels": 1}}
ENDLESS = {"gdr": {"warps": 1000, "iterations": 1000, "levels": 1}, "processing_scale": 1.0}
PLENTY = Room(most_jobs=9, most_bytes=1 << 30, most_jobs_of_owner=9, free_disk_bytes=1 << 30)


def scrape(server):
    """All samples: `{("stereomend_running", ("refine",)): 1.0}`."""
    answer = httpx.get(f"{server.url}/metrics")
    assert answer.headers["Content-Type"].startswith("text/plain; version=")
    return samples(answer.text)


def samples(text):
    return {
        (sample.name.removeprefix("stereomend_"), *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def server_timings(answer):
    entries = (entry.strip().split(";dur=") for entry in answer.headers["Server-Timing"].split(","))
    return {name: float(duration) for name, duration in entries}


def test_stages_add_up_to_what_the_answers_told(serving, post):
    with serving(workers=2) as server:
        answers = [post(server, params=QUICK) for _ in range(3)]
        answers.append(post(server, params={"stages": ["ldr"]}))
        found = scrape(server)
    told = [server_timings(answer) for answer in answers]
    for stage in ("queue", "decode", "prepare", "ldr", "gdr", "finish", "encode", "total"):
        ran = [timings[stage] for timings in told if timings[stage] > 0]
        assert found["stage_seconds_count", stage] == len(ran) >= 3
        assert found["stage_seconds_sum", stage] == pytest.approx(sum(ran) / 1e3, abs=1e-5)
    assert found["stage_seconds_count", "gdr"] == 3
    assert ("stage_seconds_count", "initial") not in found
    assert found["request_seconds_count", "POST", "/v1/refine", "200"] == 4


def test_refusals_are_counted_by_what_they_are(serving, post, connect):
    with serving(max_upload_mb=1) as server:
        with connect(server) as connection:
            connection.sendall(b"nonsense\r\n\r\n")
            assert connection.recv(1000).startswith(b"HTTP/1.1 400")
        for _ in range(2):
            post(server, params={"preset": "none"})
        post(server, accept="image/webp")
        post(server, left=bytes(3 << 20))
        post(server, left=b"no image")
        post(server, headers={"Host": "evil.example"})
        httpx.get(f"{server.url}/nothing")
        found = scrape(server)
    counted = {labels[0]: value for (name, *labels), value in found.items() if name == "refusals_total"}
    assert found["request_seconds_count", "-", "-", "400"] == 1
    assert counted == {
        "malformed-request": 1,
        "invalid-parameter": 2,
        "not-acceptable": 1,
        "body-too-large": 1,
        "unknown-format": 1,
        "forbidden": 1,
        "not-found": 1,
    }


def test_what_waits_and_runs_is_told_while_it_does(serving, post, occupy, in_background, eventually):
    with serving(work_limit_s=4) as server:
        idle = scrape(server)
        assert (
            idle["queue_depth", "refine"] == idle["running", "refine"] == idle["oldest_queued_seconds",] == 0
        )
        running = occupy(server)
        waiting = [in_background(post, server, params=QUICK) for _ in range(2)]
        eventually(lambda: scrape(server)["queue_depth", "refine"] == 2)
        first = scrape(server)
        assert first["running", "refine"] == 1
        eventually(lambda: scrape(server)["oldest_queued_seconds",] > first["oldest_queued_seconds",] + 0.3)
        assert running().status_code == 503
        assert [reply().status_code for reply in waiting] == [200, 200]
        done = scrape(server)
    assert done["queue_depth", "refine"] == done["running", "refine"] == 0
    assert done["stage_seconds_sum", "queue"] > first["oldest_queued_seconds",]


def test_each_worker_that_dies_is_a_restart(serving, post, eventually):
    with serving() as server:
        for count in (1, 2):
            (worker,) = server.workers()
            os.kill(worker, signal.SIGKILL)
            assert post(server, params=QUICK).status_code == 200
            assert scrape(server)["worker_restarts_total",] == count
        assert scrape(server)["workers_up",] == 1


@pytest.fixture
def accepted(tmp_path, scene):
    """Accept a job in the data folder of the server to come: `accepted(left=b"", preset="paper", ...)`."""

    def accept(number, left=None, params=QUICK, **changes):
        id = f"{number:032x}"
        chunks = pack(Files(left or scene.files["left"], scene.files["right"], scene.files["disparity"]))
        params = parse_params(params).model_dump(mode="json")
        job = NewJob(id, "local", "robust", params, {}, sum(map(len, chunks)), 1 << 20)
        with closing(open_ledger(tmp_path / "data")) as ledger:
            BlobStore(tmp_path / "data").put(inputs_blob(id), chunks)
            ledger.accept(replace(job, **changes), PLENTY)
        return id

    return accept


def test_durable_jobs_are_counted_by_how_they_ended(serving, accepted, tmp_path, eventually):
    for number in range(3):
        accepted(number)
    accepted(3, left=b"no image")
    late = datetime(2020, 1, 1, tzinfo=UTC)
    accepted(4, deadline=late)
    cancelled = accepted(5)
    with closing(open_ledger(tmp_path / "data")) as ledger:
        ledger.cancel(cancelled, "local")
    with serving(result_ttl_s=3600) as server:
        eventually(lambda: scrape(server)["job_outcomes_total", "succeeded"] == 3)
        eventually(lambda: scrape(server)["job_outcomes_total", "failed"] == 2)
        found = scrape(server)
    assert found["job_outcomes_total", "cancelled"] == 0  # not this server's doing
    assert found["stage_seconds_count", "gdr"] == 3
    assert found["queue_depth", "job"] == found["running", "job"] == 0


def test_jobs_that_wait_and_run_are_told_apart_from_requests(serving, accepted, eventually, tmp_path):
    for number in range(3):
        accepted(number, params=ENDLESS)
    with serving() as server:
        eventually(lambda: scrape(server)["running", "job"] >= 1)
        found = scrape(server)
        blobs = [*(tmp_path / "data" / "inputs").iterdir(), *(tmp_path / "data" / "results").iterdir()]
        assert found["running", "job"] + found["queue_depth", "job"] == 3
        assert found["running", "refine"] == found["queue_depth", "refine"] == 0
        assert found["oldest_queued_seconds",] > 0
        assert found["blob_bytes",] == sum(blob.stat().st_size for blob in blobs) > 0
        free = shutil.disk_usage(tmp_path).free
        assert found["free_disk_bytes",] == pytest.approx(free, abs=1 << 30)


def test_the_faults_of_a_gpu_are_counted_apart_from_other_crashes():
    meters = Meters()
    for outcome in (DeviceFault("gone"), WorkerCrashed("killed"), DeviceFault("gone")):
        meters.answered(None, outcome)
    figures = Figures(0, {}, {}, 0.0, 0, 0)
    assert samples(meters.text(figures).decode())["device_faults_total",] == 2


def test_openapi_describes_the_figures(server):
    described = httpx.get(f"{server.url}/openapi.json").json()["paths"]["/metrics"]["get"]["responses"]
    assert list(described["200"]["content"]) == ["text/plain"]
    assert "application/problem+json" in json.dumps(described["403"])
