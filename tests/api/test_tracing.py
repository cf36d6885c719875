"""Spans of a request, exported by a real server."""

import os
import subprocess
import sys
import threading
from contextlib import closing, contextmanager
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, HTTPServer

import httpx
import pytest
import uvicorn
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from opentelemetry.trace import SpanKind, StatusCode

from stereomend.api.app import create_app
from stereomend.api.tracing import Tracing
from stereomend.jobs.blobs import BlobStore, pack
from stereomend.jobs.folder import open_ledger
from stereomend.jobs.records import NewJob, Room, inputs_blob
from stereomend.jobs.task import Files
from stereomend.refinement import parse_params
from stereomend.settings import load_settings

QUICK = {"gdr": {"warps": 1, "levels": 1}}
TRACE, PARENT = "4bf92f3577b34da6a3ce929d0e0e4736", "00f067aa0ba902b7"


class Traced:
    def __init__(self, url):
        self.url = url


@pytest.fixture
def tracing(tmp_path, eventually):
    """A server in a thread: `with tracing() as (server, spans)`; `spans` is filled when it has ended."""

    @contextmanager
    def start():
        exporter, spans = InMemorySpanExporter(), []
        settings = load_settings(backend="reference", data_dir=tmp_path / "data")
        config = uvicorn.Config(create_app(settings, Tracing(exporter)), port=0, log_config=None)
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run)
        thread.start()
        eventually(lambda: server.started)
        port = server.servers[0].sockets[0].getsockname()[1]
        try:
            yield Traced(f"http://127.0.0.1:{port}"), spans
        finally:
            server.should_exit = True
            thread.join(60)
        spans.extend(exporter.get_finished_spans())

    return start


def test_a_request_is_a_span_of_its_callers_trace_and_holds_the_stages(tracing, post):
    headers = {"traceparent": f"00-{TRACE}-{PARENT}-01", "X-Request-ID": "theatre-3.17"}
    with tracing() as (server, spans):
        answer = post(server, params=QUICK, headers=headers)
    told = {
        name: float(duration)
        for name, duration in (
            entry.strip().split(";dur=") for entry in answer.headers["Server-Timing"].split(",")
        )
    }
    (request,) = [span for span in spans if span.kind is SpanKind.SERVER]
    assert request.name == "POST /v1/refine"
    assert f"{request.context.trace_id:032x}" == TRACE
    assert f"{request.parent.span_id:016x}" == PARENT
    assert request.attributes["http.response.status_code"] == 200
    assert request.attributes["http.route"] == "/v1/refine"
    assert request.attributes["stereomend.request_id"] == "theatre-3.17"
    stages = {span.name: span for span in spans if span is not request}
    assert stages.keys() == {name for name in told if told[name] > 0} - {"total"}
    for name, stage in stages.items():
        assert stage.parent.span_id == request.context.span_id
        assert stage.context.trace_id == request.context.trace_id
        assert (stage.end_time - stage.start_time) / 1e6 == pytest.approx(told[name], abs=1e-3)
        assert request.start_time <= stage.start_time <= stage.end_time <= request.end_time
    order = sorted(stages, key=lambda name: stages[name].start_time)
    assert order == [name for name in told if name in stages]


def test_the_stages_of_a_durable_job_belong_to_the_trace_that_sent_it(tracing, tmp_path, scene, eventually):
    files = Files(scene.files["left"], scene.files["right"], None)
    params = parse_params(QUICK).model_dump(mode="json")
    job = NewJob("0" * 32, "local", "robust", params, {}, files.size, 1 << 20)
    room = Room(most_jobs=9, most_bytes=1 << 30, most_jobs_of_owner=9, free_disk_bytes=1 << 30)
    with closing(open_ledger(tmp_path / "data")) as ledger:
        BlobStore(tmp_path / "data").put(inputs_blob(job.id), pack(files))
        ledger.accept(replace(job, traceparent=f"00-{TRACE}-{PARENT}-01"), room)
        with tracing() as (_, spans):
            eventually(lambda: ledger.get(job.id, None).state.final)
        timings = ledger.get(job.id, None).timings_ms
    assert {span.name for span in spans} == {name for name in timings if timings[name] > 0} - {"total"}
    for span in spans:
        assert f"{span.context.trace_id:032x}" == TRACE
        assert f"{span.parent.span_id:016x}" == PARENT
        assert (span.end_time - span.start_time) / 1e6 == pytest.approx(timings[span.name], abs=1e-3)


def test_what_the_caller_does_not_sample_is_not_exported(tracing):
    with tracing() as (server, spans):
        httpx.get(f"{server.url}/livez", headers={"traceparent": f"00-{TRACE}-{PARENT}-00"})
    assert spans == []


def test_a_span_tells_refusals_and_no_names(tracing, post):
    with tracing() as (server, spans):
        assert post(server, left=b"smith").status_code == 415
        httpx.get(f"{server.url}/smith?patient=smith", headers={"traceparent": "nonsense"})
    refused, unknown = spans
    assert refused.attributes["http.response.status_code"] == 415
    assert refused.status.status_code is StatusCode.UNSET
    assert unknown.name == "GET -"
    assert unknown.parent is None
    assert not [span for span in spans if "smith" in span.to_json()]


@contextmanager
def collector():
    """What an OpenTelemetry collector over HTTP would get, as spans by name."""
    spans = {}

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self):
            body = self.rfile.read(int(self.headers["Content-Length"]))
            if self.headers.get("Content-Encoding") is None and self.path == "/v1/traces":
                for resource in ExportTraceServiceRequest.FromString(body).resource_spans:
                    for scope in resource.scope_spans:
                        spans.update({span.name: span for span in scope.spans})
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_):
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}", spans
        finally:
            server.shutdown()
            thread.join()


def test_a_server_exports_to_the_collector_that_its_environment_names(serving, post, monkeypatch):
    with collector() as (endpoint, spans):
        monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", endpoint)
        with serving(log_format="json") as server:
            post(server, params=QUICK, headers={"traceparent": f"00-{TRACE}-{PARENT}-01"})
            server.process.terminate()
            assert server.process.wait(20) == 0
            log = server.log.read_text()
        assert spans.keys() >= {
            "POST /v1/refine",
            "queue",
            "decode",
            "prepare",
            "ldr",
            "gdr",
            "finish",
            "encode",
        }
        assert {span.trace_id.hex() for span in spans.values()} == {TRACE}
    assert f'"trace_id": "{TRACE}"' in log


def test_without_a_collector_nothing_of_it_is_loaded(tmp_path):
    program = (
        "import sys; from stereomend.api.app import create_app; "
        "from stereomend.settings import load_settings; "
        "create_app(load_settings(data_dir=sys.argv[1])); "
        "print([name for name in sys.modules if name.startswith('opentelemetry.sdk')])"
    )
    environment = {name: value for name, value in os.environ.items() if not name.startswith("OTEL_")}
    done = subprocess.run(
        [sys.executable, "-c", program, tmp_path],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "[]\n"
