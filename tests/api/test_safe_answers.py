"""Headers that every answer has, and what the log tells of a request."""

import base64
import hashlib
import json
import re
import signal

import httpx
import pytest

QUICK = {"gdr": {"warps": 1, "levels": 1}}


@pytest.fixture
def answers(server, post):
    """One answer of each kind, by what it is."""
    get = {
        path: httpx.get(server.url + path) for path in ("/livez", "/v1/presets", "/metrics", "/docs", "/no")
    }
    return get | {
        "asset": httpx.get(f"{server.url}/docs/assets/swagger-ui.css"),
        "result": post(server, params=QUICK),
        "refused result": post(server, params={"preset": "none"}),
        "method": httpx.get(f"{server.url}/v1/refine"),
        "origin": httpx.get(f"{server.url}/livez", headers={"Origin": "https://evil.example"}),
    }


def test_every_answer_has_the_safe_headers(answers):
    for what, answer in answers.items():
        assert answer.headers["X-Content-Type-Options"] == "nosniff", what
        assert answer.headers["X-Frame-Options"] == "DENY", what
        assert answer.headers["Referrer-Policy"] == "no-referrer", what
        assert answer.headers["Cache-Control"] == "no-store", what
        policies = answer.headers.get_list("Content-Security-Policy")
        assert len(policies) == 1, what
        directives = policies[0].split("; ")
        assert {"default-src 'none'", "frame-ancestors 'none'", "base-uri 'none'"} <= set(directives), what
        assert "'unsafe-eval'" not in policies[0], what


def test_a_fault_of_the_servers_has_them_too(serving, is_problem):
    with serving() as server:
        inputs = server.log.parent / "data" / "inputs"
        if inputs.exists():
            inputs.rename(inputs.with_name("gone"))
        inputs.write_text("no folder of blobs")
        answer = httpx.get(f"{server.url}/metrics")
        is_problem(answer, 500, "internal-error")
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert answer.headers["Cache-Control"] == "no-store"


def test_the_policy_of_the_documents_allows_their_own_script_and_no_other(answers):
    page = answers["/docs"]
    policy = dict(part.split(" ", 1) for part in page.headers["Content-Security-Policy"].split("; "))
    (script,) = re.findall(r"<script>(.*?)</script>", page.text, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert policy["script-src"].split() == ["'self'", f"'sha256-{digest}'"]
    assert policy["connect-src"] == "'self'"
    assert "data:" in policy["img-src"]
    assert all(asset.startswith("/") for asset in re.findall(r'(?:src|href)="([^"]+)"', page.text))


def test_the_log_has_no_names_pixels_or_keys(serving, scene):
    with (
        serving(api_keys="the-key", log_format="json") as server,
        httpx.Client(base_url=server.url) as client,
    ):
        files = {name: (f"smith-{name}.npy", content) for name, content in scene.files.items()}
        files["params"] = (None, json.dumps(QUICK))
        client.headers["Authorization"] = "Bearer the-key"
        assert client.post("/v1/refine?patient=smith", files=files).status_code == 200
        client.get("/smith/1.png")
        client.get("/v1/jobs/smith")
        client.post("/v1/refine", files={"smith": b"x"})
        client.post("/v1/refine", content=b"smith", headers={"Content-Type": "text/smith"})
        client.get("/livez", headers={"X-Request-ID": "smith smith", "Authorization": "Bearer smith"})
        client.get("/metrics", headers={"Authorization": "Bearer smith"})
        client.request("SMITH", "/livez")
    log = server.log.read_text()
    assert log.count('"route"') == 8
    assert "smith" not in log.lower()
    assert "the-key" not in log


def test_each_access_is_one_line_with_what_an_audit_asks_for(serving):
    job = "0123456789abcdef" * 2
    with serving(log_format="json") as server:
        given = httpx.get(f"{server.url}/v1/presets", headers={"X-Request-ID": "theatre-3.17"})
        httpx.get(f"{server.url}/v1/jobs/{job}/result")
        httpx.post(f"{server.url}/v1/refine", headers={"Host": "evil.example"})
    lines = [json.loads(line) for line in server.log.read_text().splitlines()]
    presets, result, refused = [line for line in lines if line["logger"] == "stereomend.requests"]
    assert given.headers["X-Request-ID"] == "theatre-3.17"
    assert presets["ms"] > 0
    del presets["ms"], presets["time"], presets["message"]
    assert presets == {
        "level": "info",
        "logger": "stereomend.requests",
        "key": "local",
        "method": "GET",
        "route": "/v1/presets",
        "status": 200,
        "request_id": "theatre-3.17",
        "job": "-",
    }
    assert (result["status"], result["job"]) == (404, job)
    assert (refused["status"], refused["key"], refused["route"]) == (403, "-", "/v1/refine")
    assert refused["problem"] == "forbidden"


def test_every_line_of_a_json_log_is_json(serving, occupy, connect, eventually):
    with serving(log_format="json", work_limit_s=8) as server:
        reply = occupy(server)
        with connect(server) as connection:
            connection.sendall(b"\x00nonsense\r\n\r\n")
            connection.recv(1 << 16)
        assert reply().status_code == 503
        eventually(lambda: server.log.read_text().count("a worker is ready") == 2)
        server.process.send_signal(signal.SIGTERM)
        assert server.process.wait(20) == 0
        lines = server.log.read_text().splitlines()
    for line in map(json.loads, lines):
        assert line.keys() >= {"time", "level", "logger", "message"}
    assert len(lines) >= 5


def test_an_endless_body_that_no_route_reads_takes_no_memory(serving, is_problem):
    def endless():
        for _ in range(256):
            yield bytes(1 << 20)

    with serving() as server:
        before = server.memory("VmHWM")
        for method, path in (("POST", "/v1/presets"), ("POST", "/v1/nothing"), ("GET", "/livez")):
            try:
                httpx.request(method, server.url + path, content=endless(), timeout=60)
            except httpx.TransportError:
                continue  # the server may hang up
        assert server.memory("VmHWM") < before + 64
        assert httpx.get(f"{server.url}/livez").status_code == 200
