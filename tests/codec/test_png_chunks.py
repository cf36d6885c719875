"""The chunks of a PNG against zlib's checksum."""

import struct
import zlib

import numpy as np
import pytest

from stereomend import _native

SOUND, CUT_OFF, WRONG_CHECKSUM, TOO_MANY = range(4)


def chunk(name, body):
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def find(file, at=0, most=100):
    return _native.find_chunks(np.frombuffer(file, np.uint8), at, most)


@pytest.fixture
def bodies(random):
    return [random.bytes(size) for size in (*range(40), 1000, 8192)]


def test_every_chunk_is_found_where_it_is(bodies):
    file = b"before" + b"".join(chunk(b"abCd", body) for body in bodies) + chunk(b"IEND", b"") + b"after"
    found, fault = find(file, at=6)
    assert fault == SOUND
    assert [name.to_bytes(4, "big") for name, _, _ in found] == [b"abCd"] * len(bodies) + [b"IEND"]
    assert [file[begin : begin + size] for _, begin, size in found] == [*bodies, b""]


def test_each_wrong_bit_is_noticed():
    file = chunk(b"IDAT", bytes(range(37))) + chunk(b"IEND", b"")
    for bit in range(8 * 4, 8 * (8 + 37 + 4)):
        broken = bytearray(file)
        broken[bit // 8] ^= 1 << bit % 8
        found, fault = find(bytes(broken))
        assert (len(found), fault) == (1, WRONG_CHECKSUM), bit


def test_a_file_that_ends_anywhere_is_cut_off(bodies):
    file = b"".join(chunk(b"IDAT", body) for body in bodies[:9]) + chunk(b"IEND", b"")
    for length in range(len(file)):
        assert find(file[:length])[1] == CUT_OFF


@pytest.mark.parametrize("length", [0xFFFFFFFF, 0x7FFFFFFF, 1000])
def test_a_length_beyond_the_file_is_cut_off(length):
    assert find(struct.pack(">I", length) + bytes(100)) == ([], CUT_OFF)


def test_chunks_are_counted():
    file = chunk(b"tEXt", b"") * 5 + chunk(b"IEND", b"")
    assert find(file, most=5)[1] == TOO_MANY
    assert find(file, most=6)[1] == SOUND


def test_a_place_outside_of_the_file_is_refused():
    with pytest.raises(ValueError, match="at"):
        find(b"abc", at=4)
