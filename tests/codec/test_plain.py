from __future__ import annotations

import gc
import io
import struct
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from stereomend.codec import decode_disparity, decode_image
from stereomend.errors import DamagedFile, InputError, TooManyPixels, UnknownFormat
from stereomend.opencv import cv2

SIZES = [(1, 1), (1, 13), (13, 1), (37, 53)]
LIMIT = 10_000


def npy_header(text: str, version: tuple[int, int] = (1, 0)) -> bytes:
    length = struct.pack("<H" if version == (1, 0) else "<I", len(text) + 1)
    return b"\x93NUMPY" + bytes(version) + length + text.encode() + b"\n"


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("dtype", ["u1", "<u2", ">u2"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npy_images_come_back_in_native_order_row_by_row(npy, random, shape, dtype, order):
    for axes in (shape, (*shape, 3)):
        samples = np.asarray(random.integers(0, 250, axes), dtype=dtype, order=order)
        image = decode_image(npy(samples), "left", LIMIT)
        np.testing.assert_array_equal(image, samples)
        assert image.dtype.isnative
        assert image.flags.c_contiguous
        assert image.flags.writeable


@pytest.mark.parametrize("dtype", ["<f2", ">f2", "<f4", ">f4", "<f8", ">f8"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_float_npy_maps_come_back(npy, random, dtype, order):
    disparity = np.asarray(random.integers(1, 999, (37, 53)) / 8, dtype=dtype, order=order)
    np.testing.assert_array_equal(decode_disparity(npy(disparity), "disparity", LIMIT).values, disparity)


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
def test_every_version_of_npy_is_read(version):
    samples = np.arange(6, dtype=np.uint8).reshape(2, 3)
    data = npy_header("{'descr': '|u1', 'fortran_order': False, 'shape': (2, 3)}", version)
    np.testing.assert_array_equal(decode_image(data + samples.tobytes(), "left", LIMIT), samples)


def test_bytes_after_an_array_are_ignored_as_numpy_does(npy):
    first, second = np.ones((2, 3), np.uint8), np.zeros((2, 3), np.uint8)
    np.testing.assert_array_equal(decode_image(npy(first) + npy(second), "left", LIMIT), first)


class Trap:
    def __reduce__(self):
        return (pytest.fail, ("unpickled",))


@pytest.mark.parametrize(
    ("array", "says"),
    [
        (np.full((2, 3), Trap(), dtype=object), "Python objects"),
        (np.zeros((2, 3), bool), "NPY of bool, 1 channel"),
        (np.zeros((2, 3), complex), "complex128"),
        (np.zeros((2, 3), "S5"), "bytes40"),
        (np.zeros((2, 3), "M8[s]"), "datetime64"),
        (np.zeros((2, 3), np.longdouble), "float128"),
        (np.zeros((2, 3), [("a", "u1"), ("b", "u1")]), "records"),
        (np.zeros((), np.uint8), "0 axes"),
        (np.zeros(6, np.uint8), "1 axes"),
        (np.zeros((1, 2, 3, 3), np.uint8), "4 axes"),
        (np.zeros((2, 3, 4), np.uint8), r"shape \(2, 3, 4\)"),
        (np.zeros((3, 20, 30), np.uint8), r"shape \(3, 20, 30\)"),
        (np.zeros((2, 3), np.int16), "NPY of int16, 1 channel"),
        (np.zeros((2, 3, 3), np.float32), "NPY of float32, 3 channels"),
    ],
)
def test_other_arrays_are_refused_and_never_unpickled(npy, array, says):
    with pytest.raises(UnknownFormat, match=f"^left: .*{says}.*expected"):
        decode_image(npy(array), "left", LIMIT)


@pytest.mark.parametrize(
    ("shape", "error"),
    [
        ("(0, 3)", DamagedFile),
        ("(3, 0)", DamagedFile),
        ("(-1, 3)", DamagedFile),
        ("(9" + "9" * 400 + ", 1)", DamagedFile),
        ("(1000000, 1000000)", TooManyPixels),
        ("(2, 3)", DamagedFile),
        ("(2.0, 3)", DamagedFile),
        ("(2, [3])", DamagedFile),
        ("__import__('os').abort()", DamagedFile),
        ("(" * 400 + ")" * 400, DamagedFile),
    ],
)
def test_npy_headers_that_promise_too_much_or_nonsense_are_refused(shape, error):
    header = npy_header(f"{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}}}")
    with pytest.raises(error, match=r"^left: .{,200}$"):
        decode_image(header + b"12345", "left", LIMIT)


def test_a_cut_file_says_how_many_bytes_were_expected_and_came(npy):
    data = npy(np.zeros((10, 20), np.uint16))
    with pytest.raises(DamagedFile, match=f"{len(data) - 1} bytes came, its header promises {len(data)}"):
        decode_image(data[:-1], "left", LIMIT)


def files(npy, pfm) -> dict[str, bytes]:
    samples = np.arange(7 * 9 * 3, dtype=np.uint8).reshape(7, 9, 3)
    return {
        "npy": npy(samples[:, :, 0] + np.float32(1)),
        "pfm": pfm(samples[:, :, 0] + 1),
        "bmp": cv2.imencode(".bmp", samples)[1].tobytes(),
        "pgm": cv2.imencode(".pgm", samples[:, :, 0])[1].tobytes(),
        "ppm": cv2.imencode(".ppm", samples)[1].tobytes(),
    }


@pytest.mark.parametrize("kind", ["npy", "pfm", "bmp", "pgm", "ppm"])
def test_a_file_cut_anywhere_is_refused(npy, pfm, kind):
    data = files(npy, pfm)[kind]
    decode = decode_disparity if kind in ("npy", "pfm") else decode_image
    assert decode(data, "part", LIMIT).shape[:2] == (7, 9)
    for length in range(len(data)):
        with pytest.raises(InputError, match=r"^part: "):
            decode(data[:length], "part", LIMIT)


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("scale", ["-1.0", "1.0", "-0.00333333", "255", "-1e2"])
def test_pfm_starts_with_the_bottom_row_and_only_the_sign_of_its_scale_counts(pfm, random, shape, scale):
    disparity = (random.integers(1, 999, shape) / 8).astype(np.float32)
    np.testing.assert_array_equal(
        decode_disparity(pfm(disparity, scale), "disparity", LIMIT).values, disparity
    )


def test_a_pfm_with_carriage_returns_is_read(pfm):
    disparity = np.arange(1, 7, dtype=np.float32).reshape(2, 3)
    data = pfm(disparity).replace(b"\n", b"\r\n", 3)
    np.testing.assert_array_equal(decode_disparity(data, "disparity", LIMIT).values, disparity)


@pytest.mark.parametrize("scale", ["0", "-0.0", "nan", "1e999", "-", "+-1", "x"])
def test_a_pfm_scale_that_is_no_byte_order_is_refused(pfm, scale):
    with pytest.raises(DamagedFile, match="PFM"):
        decode_disparity(pfm(np.ones((2, 3)), scale), "disparity", LIMIT)


def test_pfm_colour_is_no_disparity_and_pfm_no_image(pfm):
    with pytest.raises(UnknownFormat, match="PFM of float32, 3 channels"):
        decode_disparity(pfm(np.ones((2, 3, 3)), kind="PF"), "disparity", LIMIT)
    with pytest.raises(UnknownFormat, match="PFM of float32, 1 channel"):
        decode_image(pfm(np.ones((2, 3))), "left", LIMIT)


@pytest.mark.parametrize(
    "header", [b"Pf\n99999 99999\n-1\n", b"P5\n99999 99999\n255\n", b"P6 99999 99999 65535\n"]
)
def test_huge_plain_files_are_refused_by_their_header(header):
    decode = decode_disparity if header.startswith(b"Pf") else decode_image
    start = time.process_time()
    with pytest.raises(TooManyPixels, match="99999 x 99999"):
        decode(header + bytes(1_000_000), "part", 16_000_000)
    assert time.process_time() - start < 0.05


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_binary_pnm_comes_back(random, shape, dtype):
    largest = np.iinfo(dtype).max
    grey = random.integers(0, largest, shape, dtype, endpoint=True)
    data = (
        f"P5\n# a comment\n{shape[1]} {shape[0]}\n{largest}\n".encode()
        + grey.astype(f">u{grey.itemsize}").tobytes()
    )
    np.testing.assert_array_equal(decode_image(data, "left", LIMIT), grey)
    colour = random.integers(0, largest, (*shape, 3), dtype, endpoint=True)
    data = f"P6 {shape[1]} {shape[0]} {largest}\n".encode() + colour.astype(f">u{grey.itemsize}").tobytes()
    image = decode_image(data, "left", LIMIT)
    assert image.dtype == dtype
    np.testing.assert_array_equal(image, colour)


def test_pnm_with_another_largest_value_is_refused():
    with pytest.raises(UnknownFormat, match="1023"):
        decode_image(b"P5 1 1 1023\n\0\0", "left", LIMIT)


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_bitmaps_come_back(random, shape, channels):
    samples = random.integers(0, 256, (*shape, channels), np.uint8)
    bgr = samples if channels == 1 else samples[:, :, [2, 1, 0, 3][:channels]]
    data = cv2.imencode(".bmp", bgr, [cv2.IMWRITE_BMP_COMPRESSION, 0])[1].tobytes()
    np.testing.assert_array_equal(
        decode_image(data, "left", LIMIT), samples[:, :, 0] if channels == 1 else samples[:, :, :3]
    )


def bmp(size: tuple[int, int], bits: int, pixels: bytes, palette: bytes = b"", compression: int = 0) -> bytes:
    start, colours = 54 + len(palette), len(palette) // 4
    header = struct.pack("<IiiHHIIiiII", 40, *size, 1, bits, compression, 0, 0, 0, colours, 0)
    return struct.pack("<2sIHHI", b"BM", start + len(pixels), 0, 0, start) + header + palette + pixels


def test_bitmaps_start_at_the_bottom_unless_their_height_is_negative():
    rows = bytes([1, 0, 0, 0, 2, 0, 0, 0])
    palette = bytes([0, 0, 0, 0, 10, 20, 30, 0, 40, 50, 60, 0])  # blue, green, red, nothing
    upwards = decode_image(bmp((1, 2), 8, rows, palette), "left", LIMIT)
    np.testing.assert_array_equal(upwards, [[[60, 50, 40]], [[30, 20, 10]]])
    downwards = decode_image(bmp((1, -2), 8, rows, palette), "left", LIMIT)
    np.testing.assert_array_equal(downwards, upwards[::-1])


@pytest.mark.parametrize(
    ("data", "error"),
    [
        (bmp((4, 4), 8, bytes(16), bytes(1024), compression=1), UnknownFormat),
        (bmp((4, 4), 16, bytes(32)), UnknownFormat),
        (bmp((4, 4), 1, bytes(16), bytes(8)), UnknownFormat),
        (bmp((-4, 4), 24, bytes(48)), DamagedFile),
        (bmp((0, 4), 24, bytes(48)), DamagedFile),
        (bmp((4, 4), 8, bytes(16)), DamagedFile),
        (bmp((4, -(2**31)), 24, bytes(48)), TooManyPixels),
    ],
)
def test_other_bitmaps_are_refused(data, error):
    with pytest.raises(error):
        decode_image(data, "left", LIMIT)


def test_opencv_and_numpy_read_these_files_alike(random):
    image = random.integers(0, 256, (37, 53, 3), np.uint8)
    for ending in (".png", ".bmp", ".ppm", ".tiff"):
        data = cv2.imencode(ending, image)[1]
        np.testing.assert_array_equal(decode_image(data.tobytes(), "left", LIMIT), image[:, :, ::-1])
    file = io.BytesIO()
    np.save(file, image)
    np.testing.assert_array_equal(
        decode_image(file.getvalue(), "left", LIMIT), np.load(io.BytesIO(file.getvalue()))
    )


@pytest.fixture
def restless():
    """Many garbage collections, each of which lets another thread in."""

    def let_others_in(phase, info):
        time.sleep(0)

    before = gc.get_threshold()
    gc.callbacks.append(let_others_in)
    gc.set_threshold(5)
    yield
    gc.set_threshold(*before)
    gc.callbacks.remove(let_others_in)


def test_files_are_read_side_by_side_without_disturbing_each_other(restless):
    stream = io.BytesIO()
    np.save(stream, np.zeros((3, 4), np.uint8))
    with ThreadPoolExecutor(8) as pool:
        images = list(pool.map(lambda _: decode_image(stream.getvalue(), "left", 100), range(2000)))
    assert all(image.shape == (3, 4) for image in images)
