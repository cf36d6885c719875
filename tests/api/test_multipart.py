"""Forms in memory, whatever the pieces they come in."""

import asyncio

import httpx
import numpy as np
import pytest

from stereomend.api.multipart import Part, read_form
from stereomend.errors import MalformedRequest

TYPE = "multipart/form-data; boundary=x"


def read(body, step=None, content_type=TYPE):
    async def pieces():
        for begin in range(0, len(body), step or max(1, len(body))):
            yield body[begin : begin + (step or len(body))]

    return asyncio.run(read_form(content_type, pieces()))


def part(headers, content):
    return b"--x\r\n" + headers + b"\r\n\r\n" + content + b"\r\n"


@pytest.mark.parametrize("step", [1, 2, 3, 7, 64, 1000, None])
def test_a_form_is_read_the_same_in_pieces_of_any_size(step):
    random = np.random.default_rng(0)
    sent = {"left": random.bytes(700), "right": b"\r\n--", "disparity": b"\r\n--boundar" * 9, "mask": b""}
    files = {name: (name, content) for name, content in sent.items()} | {"params": (None, "{}")}
    headers = {"Content-Type": "multipart/form-data; boundary=boundary"}
    request = httpx.Request("POST", "http://localhost", files=files, headers=headers)
    expected = [Part(name, True, content) for name, content in sent.items()] + [Part("params", False, b"{}")]
    assert read(request.read(), step, request.headers["Content-Type"]) == expected


def test_a_part_that_is_cut_off_is_left_out():
    whole = part(b'Content-Disposition: form-data; name="a"', b"1") + b"--x--\r\n"
    for length in range(len(whole) - len(b"--\r\n")):
        assert read(whole[:length]) == []


def test_the_last_disposition_of_a_part_counts_and_other_headers_do_not():
    headers = b'X: name="z"\r\ncontent-DISPOSITION: form-data; name="a"; filename="f"\r\nContent-Type: a/b'
    assert read(part(headers, b"1") + b"--x--") == [Part("a", True, b"1")]


def test_a_name_may_be_in_utf8_or_latin1():
    for name in ("é".encode(), "é".encode("latin-1")):
        body = part(b'Content-Disposition: form-data; name="' + name + b'"', b"1") + b"--x--"
        assert [part.name for part in read(body)] == ["é"]


@pytest.mark.parametrize("headers", [b"", b"Content-Type: a/b", b"Content-Disposition: form-data"])
def test_a_part_without_a_name_is_malformed(headers):
    with pytest.raises(MalformedRequest):
        read(part(headers, b"1") + b"--x--")


def test_too_many_parts_are_malformed():
    one = part(b'Content-Disposition: form-data; name="a"', b"1")
    assert len(read(one * 32 + b"--x--")) == 32
    with pytest.raises(MalformedRequest, match="32 parts"):
        read(one * 33 + b"--x--")


def test_a_form_needs_a_boundary():
    with pytest.raises(MalformedRequest, match="boundary"):
        read(b"", content_type="multipart/form-data")
