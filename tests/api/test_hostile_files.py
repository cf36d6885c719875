"""Files made to hurt: refused quickly, with little memory, and the next request is served."""

import io
import struct
import time
import zlib

import cv2
import numpy as np
import pytest
from trials.originals import FORMATS
from trials.posting import post_mutants, target, warm_up

QUICK = {"gdr": {"warps": 1, "levels": 1}}

MOST_GROWTH_MB = 200
LIVELY_S = 3
MUTANTS = 60


def npy(array, allow_pickle=False):
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=allow_pickle)
    return stream.getvalue()


def npz(array):
    stream = io.BytesIO()
    np.savez(stream, array)
    return stream.getvalue()


def png(array):
    return cv2.imencode(".png", array)[1].tobytes()


def chunk(kind, content):
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def promising_png(width, height, pixels=b""):
    """A PNG whose header promises `width` x `height` pixels of 8-bit grey, whatever follows."""
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    data = zlib.compress(pixels, 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def promising_npy(shape):
    stream = io.BytesIO()
    header = {"descr": "|u1", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + bytes(64)


GREY = np.full((48, 64), 100, np.uint8)
MAP = np.full((48, 64), 5.0, np.float32)

HOSTILE = {
    "an empty image": ({"left": b""}, 422, "damaged-file"),
    "a truncated PNG": (
        {"left": png(np.arange(3072, dtype=np.uint8).reshape(48, 64))[:-80]},
        422,
        "damaged-file",
    ),
    "a truncated NPY": ({"left": npy(GREY)[:-1]}, 422, "damaged-file"),
    "a PNG that promises 900 Mpx": ({"left": promising_png(30000, 30000)}, 413, "too-many-pixels"),
    "a PNG that inflates to 900 MB": (
        {"left": promising_png(30000, 30000, bytes(900_000_000))},
        413,
        "too-many-pixels",
    ),
    "a PNG with more data than pixels": (
        {"left": promising_png(64, 48, bytes(500_000_000))},
        422,
        "damaged-file",
    ),
    "an NPY that promises 900 Mpx": ({"left": promising_npy((30000, 30000))}, 413, "too-many-pixels"),
    "an NPY with negative sides": ({"left": promising_npy((-4, -4))}, 422, "damaged-file"),
    "a pickled NPY": ({"left": npy(np.array([{}, []], object), True)}, 415, "unknown-format"),
    "a pickled disparity": ({"disparity": npy(np.array([[None]], object), True)}, 415, "unknown-format"),
    "an NPZ as an image": ({"left": npz(GREY)}, 415, "unknown-format"),
    "text as an image": ({"left": b"hello"}, 415, "unknown-format"),
    "floats as an image": ({"left": npy(MAP)}, 415, "unknown-format"),
    "a colour picture as a disparity": (
        {"disparity": png(np.zeros((48, 64, 3), np.uint8))},
        415,
        "unknown-format",
    ),
    "integers without a scale": ({"disparity": npy(GREY)}, 422, "invalid-parameter"),
    "a right image of another size": ({"right": npy(GREY[:-1])}, 422, "shape-mismatch"),
    "a disparity of another size": ({"disparity": npy(MAP[:, :-1])}, 422, "shape-mismatch"),
    "a disparity of zeros": ({"disparity": npy(0 * MAP)}, 422, "no-valid-disparity"),
    "a disparity of NaN": ({"disparity": npy(np.nan * MAP)}, 422, "no-valid-disparity"),
    "a disparity of infinities": ({"disparity": npy(np.inf * MAP)}, 422, "no-valid-disparity"),
    "a constant pair": ({"left": npy(GREY), "right": npy(GREY), "disparity": npy(MAP)}, 200, None),
    "a pair of one pixel": (
        {"left": npy(GREY[:1, :1]), "right": npy(GREY[:1, :1]), "disparity": npy(MAP[:1, :1] / 10)},
        200,
        None,
    ),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_hostile_file_is_answered_at_little_cost(server, post, is_problem, what):
    files, status, slug = HOSTILE[what]
    post(server, params=QUICK)
    worker, before = server.workers(), server.memory("VmRSS")
    began = time.monotonic()
    response = post(server, params=QUICK, **files)
    assert time.monotonic() - began < LIVELY_S
    if slug:
        is_problem(response, status, slug)
    else:
        assert response.status_code == status
    assert server.memory("VmHWM") - before < MOST_GROWTH_MB
    assert server.workers() == worker
    assert post(server, params=QUICK).status_code == 200


def test_a_disparity_too_large_for_a_png_names_the_formats_that_hold_it(server, post, is_problem):
    wide = npy(np.full((8, 600), 100, np.uint8))
    large = {"left": wide, "right": wide, "disparity": npy(np.full((8, 600), 300, np.float32))}
    response = post(
        server, accept="image/png", params={"stages": ["ldr"], "ldr": {"min_confidence": 0}}, **large
    )
    assert "NPY" in is_problem(response, 422, "disparity-out-of-range")["detail"]


@pytest.fixture(scope="module")
def besieged():
    with target() as server:
        warm_up(server)
        yield server


@pytest.mark.parametrize("format", FORMATS, ids=str)
def test_damaged_uploads_over_several_connections_do_no_harm(besieged, format):
    found = post_mutants(besieged, format, range(MUTANTS), seed=2)
    assert not found.faults
    assert sum(found.statuses.values()) == MUTANTS
    assert found.workers_replaced == 0
    assert sum(found.grown_mb.values()) < MOST_GROWTH_MB
