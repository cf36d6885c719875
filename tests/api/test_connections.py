"""What is no request, or does not end: answered with a problem document, and the connection ended."""

from itertools import count, islice, repeat

import httpx
import pytest

from stereomend.api.protocol import LONGEST_HEAD

GET = b"GET /livez HTTP/1.1\r\nHost: localhost\r\n"
POST = b"POST /v1/refine HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n"
PIECE = b"x" * 1000


def endless(begin, piece):
    yield begin
    for number in count():
        yield piece(number)


def headers(number):
    return b"X-%d: %s\r\n" % (number, PIECE)


def one_piece(number):
    return PIECE


ENDLESS = {
    "url": (b"GET /", one_piece),
    "method": (b"", one_piece),
    "headers": (GET, headers),
    "header": (GET + b"X: ", one_piece),
    "name of a header": (GET, one_piece),
    "trailers": (POST + b"\r\n1\r\nx\r\n0\r\n", headers),
    "trailer": (POST + b"\r\n1\r\nx\r\n0\r\nX: ", one_piece),
    "extension of a chunk": (POST + b"\r\n1;x=", one_piece),
}


def send_all(connection, pieces):
    for piece in pieces:
        connection.sendall(piece)


@pytest.mark.parametrize("what", ENDLESS)
def test_what_does_not_end_is_ended(server, connect, what):
    pieces = islice(endless(*ENDLESS[what]), 64_000)  # 64 MB, more than sockets hold
    with connect(server) as connection, pytest.raises(ConnectionError):
        send_all(connection, pieces)
    assert httpx.get(f"{server.url}/livez").status_code == 200


NOBODY_READS = [
    b"GET /livez",
    b"DELETE /v1/refine",
    b"POST /v1/nothing",
    b"POST /v1/jobs/unknown/cancel",
    b"DELETE /v1/jobs/unknown",
    b"POST /v1/refine",
]


@pytest.mark.parametrize("request_line", NOBODY_READS)
def test_a_body_that_nobody_reads_is_ended_too(serving, connect, request_line):
    begin = request_line + b" HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n"
    chunk = b"3e8\r\n" + PIECE + b"\r\n"
    with serving(max_upload_mb=1) as server, connect(server) as connection:
        send_all(connection, islice(endless(begin, lambda _: chunk), 1000))
        assert connection.recv(9) == b"HTTP/1.1 "
        with pytest.raises(ConnectionError):
            send_all(connection, repeat(chunk, 64_000))


def test_an_answer_before_its_body_is_seen(serving):
    with serving(max_upload_mb=1) as server, httpx.Client(base_url=server.url) as client:
        for _ in range(2):
            answer = client.post("/v1/jobs/unknown/cancel", content=bytes(1 << 20))
            assert answer.status_code == 404


def test_headers_up_to_the_bound_are_read(server):
    response = httpx.get(f"{server.url}/livez", headers={"X": "x" * (LONGEST_HEAD - 1000)})
    assert response.status_code == 200


@pytest.fixture
def answer_to(server, connect):
    """What comes back for bytes, as httpx reads it."""

    def ask(request):
        with connect(server) as connection:
            connection.sendall(request)
            head, body = connection.makefile("rb").read().split(b"\r\n\r\n")
        status, *lines = head.decode().split("\r\n")
        assert status == "HTTP/1.1 400 Bad Request"
        return httpx.Response(400, headers=[line.split(": ", 1) for line in lines], content=body)

    return ask


def test_a_longer_head_is_a_bad_request(answer_to, is_problem):
    answer = answer_to(GET + b"X: " + b"x" * LONGEST_HEAD)
    assert str(LONGEST_HEAD) in is_problem(answer, 400, "malformed-request")["detail"]


@pytest.mark.parametrize(
    "request_",
    [b"nonsense\r\n\r\n", b"SMITH /livez HTTP/1.1\r\nHost: localhost\r\n\r\n", GET + b"X y: z\r\n\r\n"],
)
def test_what_is_no_request_gets_a_problem_document(answer_to, is_problem, request_):
    answer = answer_to(request_)
    is_problem(answer, 400, "malformed-request")
    assert answer.headers["Cache-Control"] == "no-store"
    assert answer.headers["Connection"] == "close"
    assert "Date" in answer.headers


def test_the_bound_is_of_one_request_not_of_a_connection(server):
    with httpx.Client() as client:
        for _ in range(5):
            response = client.get(f"{server.url}/livez", headers={"X": "x" * (LONGEST_HEAD // 2)})
            assert response.status_code == 200
