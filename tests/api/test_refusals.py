"""Every refusal is a problem document with the right status."""

import time

import httpx
import numpy as np
import pytest

QUICK = {"gdr": {"warps": 1, "levels": 1}}
ENDLESS = {"gdr": {"warps": 1000, "iterations": 1000, "levels": 1}, "processing_scale": 1.0}

HEADERS = "POST /v1/refine HTTP/1.1\r\nHost: localhost\r\nContent-Type: multipart/form-data; boundary=x\r\n"


@pytest.fixture
def send_headers(connect):
    """Send the headers of a request and none of its body, and give what comes back."""

    def send(server, headers):
        with connect(server) as connection:
            connection.sendall((HEADERS + headers + "\r\n\r\n").encode())
            return connection.recv(1 << 16).decode()

    return send


def test_an_unknown_part_is_named(server, post, is_problem):
    assert "'mirror'" in is_problem(post(server, mirror=b"x"), 400, "malformed-request")["detail"]


def test_a_missing_part_is_named(server, post, is_problem):
    assert "'right'" in is_problem(post(server, right=None), 400, "malformed-request")["detail"]


def test_a_part_that_comes_twice_is_named(server, scene, is_problem):
    files = [("left", ("left", scene.files["left"]))] * 2
    response = httpx.post(f"{server.url}/v1/refine", files=files)
    assert "'left' came 2 times" in is_problem(response, 400, "malformed-request")["detail"]


def test_an_image_that_is_text_is_refused(server, is_problem):
    response = httpx.post(f"{server.url}/v1/refine", files={"left": (None, "x"), "right": ("right", b"x")})
    assert "'left' is text" in is_problem(response, 400, "malformed-request")["detail"]


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"--x\r\n",
        b"nonsense",
        b'--x\r\nContent-Disposition: form-data; name="left"; filename="l"\r\n\r\nabc',
    ],
)
def test_a_broken_multipart_body_is_malformed(server, is_problem, body):
    headers = {"Content-Type": "multipart/form-data; boundary=x"}
    is_problem(httpx.post(f"{server.url}/v1/refine", content=body, headers=headers), 400, "malformed-request")


def test_a_boundary_must_be_given(server, is_problem):
    headers = {"Content-Type": "multipart/form-data"}
    is_problem(httpx.post(f"{server.url}/v1/refine", content=b"x", headers=headers), 400, "malformed-request")


def test_a_body_that_is_not_multipart_is_an_unknown_format(server, is_problem):
    is_problem(httpx.post(f"{server.url}/v1/refine", json={}), 415, "unknown-format")


@pytest.mark.parametrize("path", ["/", "/v1/nothing", "/docs/assets/nothing.js", "/v1/refine/"])
def test_an_unknown_path_is_not_found(server, is_problem, path):
    is_problem(httpx.get(server.url + path), 404, "not-found")


def test_a_wrong_method_is_not_found_and_told_the_right_one(server, is_problem):
    response = httpx.get(f"{server.url}/v1/refine")
    is_problem(response, 405, "not-found")
    assert response.headers["Allow"] == "POST"


def test_what_is_not_offered_is_not_acceptable_and_the_offers_are_listed(server, post, is_problem):
    detail = is_problem(post(server, accept="image/webp"), 406, "not-acceptable")["detail"]
    assert "image/png" in detail
    assert "application/zip" in detail


@pytest.mark.parametrize(
    ("params", "where"),
    [
        ("{", "params"),
        ("[1]", "params"),
        ("[" * 60_000, "params"),
        ('{"gdr": {"warps": %s}}' % ("9" * 5000), "params"),
        ('{"gdr": {"warps": 0}}', "gdr.warps"),
        ('{"gdr": {"wraps": 5}}', "gdr.wraps"),
        ('{"ldr": {"window": NaN}}', "ldr.window"),
        ('{"\\ud800": 1}', "params"),
        ('{"preset": "none"}', "preset"),
        (" " * 70_000 + "{}", "65536"),
    ],
    ids=range(10),
)
def test_a_wrong_parameter_is_named(server, post, is_problem, params, where):
    assert where in is_problem(post(server, params=params), 422, "invalid-parameter")["detail"]


def test_an_upload_that_is_asked_for_must_be_there(server, post, is_problem):
    response = post(server, params={"initial": "upload"}, disparity=None)
    is_problem(response, 422, "invalid-parameter")


def test_depth_needs_a_calibration_and_is_refused_before_any_file_is_read(server, post, is_problem):
    for accept, params in (("application/ply", {}), ("application/zip", {"outputs": ["depth_mm"]})):
        problem = is_problem(
            post(server, accept=accept, params=params, left=b"no image"), 422, "invalid-parameter"
        )
        assert "focal_px" in problem["detail"]
        assert "baseline_mm" in problem["detail"]
    problem = is_problem(post(server, params={"focal_px": 100}), 422, "invalid-parameter")
    assert "baseline_mm is missing" in problem["detail"]


def test_a_mask_that_does_not_fit_is_refused(server, post, is_problem, scene, as_npy):
    ones = np.ones(scene.disparity.shape, np.uint8)
    detail = is_problem(post(server, mask=as_npy(ones[1:])), 422, "shape-mismatch")["detail"]
    assert "mask is 64 x 47" in detail
    assert "left is 64 x 48" in detail
    is_problem(post(server, mask=as_npy(ones * 0)), 422, "invalid-parameter")
    is_problem(post(server, mask=as_npy(ones * 0.5)), 415, "unknown-format")


@pytest.mark.parametrize("name", ["disparity", "mask"])
def test_an_empty_file_is_not_taken_for_none(server, post, is_problem, name):
    detail = is_problem(post(server, **{name: b""}), 422, "damaged-file")["detail"]
    assert detail.startswith(f"{name}: the file is empty")


def test_a_body_announced_too_large_is_refused_before_it_is_sent(serving, is_problem, send_headers):
    with serving(max_upload_mb=1) as server:
        answer = send_headers(server, f"Content-Length: {10**12}")
        assert answer.startswith("HTTP/1.1 413 ")
        assert "application/problem+json" in answer
        assert "x-request-id" in answer.lower()


def test_a_body_that_grows_too_large_is_refused(serving, post, is_problem):
    def endless_body():
        yield b'--x\r\nContent-Disposition: form-data; name="left"; filename="l"\r\n\r\n'
        for _ in range(64):
            yield bytes(1 << 16)

    with serving(max_upload_mb=1) as server:
        headers = {"Content-Type": "multipart/form-data; boundary=x"}
        response = httpx.post(f"{server.url}/v1/refine", content=endless_body(), headers=headers)
        is_problem(response, 413, "body-too-large")
        is_problem(post(server, left=bytes(3 << 20)), 413, "body-too-large")
        assert httpx.get(f"{server.url}/livez").status_code == 200


def test_without_a_key_nothing_is_read(serving, post, is_problem, send_headers):
    with serving(api_keys="first, second") as server:
        for key in ("", "Bearer ", "Bearer wrong", "Bearer first,", "Basic first", "Bearer f\xefrst"):
            headers = f"Content-Length: {10**12}\r\nAuthorization: {key}"
            began = time.monotonic()
            answer = send_headers(server, headers)
            assert answer.startswith("HTTP/1.1 401 "), key
            assert "www-authenticate: bearer" in answer.lower()
            assert time.monotonic() - began < 5
        is_problem(post(server, left=bytes(20 << 20)), 401, "unauthorized")
        is_problem(httpx.get(f"{server.url}/v1/presets"), 401, "unauthorized")
        for key in ("first", "second"):
            assert post(server, params=QUICK, headers={"Authorization": f"Bearer {key}"}).status_code == 200
        for path in ("/livez", "/readyz"):
            assert httpx.get(server.url + path).status_code == 200
        assert "first" not in server.log.read_text()


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "127.0.0.1.evil.example"},
        {"Host": "["},
        {"Origin": "https://evil.example"},
        {"Origin": "null"},
    ],
)
def test_without_keys_a_web_page_cannot_use_the_server(server, post, is_problem, headers):
    is_problem(post(server, headers=headers), 403, "forbidden")


@pytest.mark.parametrize("headers", [{"Host": "localhost:9000"}, {"Origin": "http://localhost:3000"}])
def test_without_keys_local_programs_and_pages_can(server, post, headers):
    assert post(server, params=QUICK, headers=headers).status_code == 200


def test_a_full_queue_says_when_to_come_again(serving, post, occupy, is_problem):
    with serving(max_queued_jobs=1, work_limit_s=3) as server:
        first = occupy(server)
        response = post(server)
        is_problem(response, 429, "queue-full")
        assert int(response.headers["Retry-After"]) >= 1
        is_problem(first(), 503, "work-limit-exceeded")
        assert post(server).status_code == 200
