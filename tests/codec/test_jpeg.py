from __future__ import annotations

import struct

import numpy as np
import pytest

from stereomend.codec import decode_image
from stereomend.errors import DamagedFile, InputError, TooManyPixels, UnknownFormat
from stereomend.opencv import cv2

LIMIT = 10_000
KINDS = {
    "baseline": [],
    "progressive": [cv2.IMWRITE_JPEG_PROGRESSIVE, 1],
    "restarts": [cv2.IMWRITE_JPEG_RST_INTERVAL, 1],
}


def jpeg(rgb: np.ndarray, options: list[int] | None = None) -> bytes:
    stored = rgb if rgb.ndim == 2 else rgb[:, :, ::-1]
    return cv2.imencode(".jpg", stored, [cv2.IMWRITE_JPEG_QUALITY, 98, *(options or [])])[1].tobytes()


def scene(height: int, width: int) -> np.ndarray:
    rows, columns = np.mgrid[0:height, 0:width]
    return np.stack([80 + rows, 90 + columns, 200 - rows], axis=-1).astype(np.uint8)


def insert(data: bytes, marker: int, body: bytes) -> bytes:
    return data[:2] + struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body + data[2:]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (17, 1), (37, 53)])
def test_colours_are_rgb_and_close_to_what_was_written(kind, shape):
    image = decode_image(jpeg(scene(*shape), KINDS[kind]), "left", LIMIT)
    assert image.dtype == np.uint8
    np.testing.assert_allclose(image, scene(*shape), atol=6)


def test_grey_stays_grey():
    grey = scene(21, 34)[:, :, 1]
    image = decode_image(jpeg(grey), "left", LIMIT)
    assert image.shape == (21, 34)
    np.testing.assert_allclose(image, grey, atol=3)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_orientation_tag_is_ignored(orientation):
    exif = b"Exif\0\0MM\0*" + struct.pack(">IHHHIHHI", 8, 1, 274, 3, 1, orientation, 0, 0)
    image = decode_image(insert(jpeg(scene(8, 24)), 0xE1, exif), "left", LIMIT)
    np.testing.assert_allclose(image, scene(8, 24), atol=6)


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_cut_anywhere_is_refused(kind):
    data = jpeg(scene(9, 14), KINDS[kind])
    for length in range(len(data)):
        with pytest.raises(InputError, match=r"^left: "):
            decode_image(data[:length], "left", LIMIT)


def test_a_thumbnail_in_the_metadata_does_not_pass_for_the_end_of_the_image():
    data = insert(jpeg(scene(16, 16)), 0xE1, b"Exif\0\0" + jpeg(scene(4, 4)))
    np.testing.assert_allclose(decode_image(data, "left", LIMIT), scene(16, 16), atol=6)
    with pytest.raises(DamagedFile, match="cut off"):
        decode_image(data[:-40], "left", LIMIT)


def test_fill_bytes_before_markers_and_bytes_after_the_end_are_allowed():
    data = jpeg(scene(16, 16))
    padded = data[:2] + b"\xff" * 1000 + data[2:] + b"trailer"
    np.testing.assert_array_equal(decode_image(padded, "left", LIMIT), decode_image(data, "left", LIMIT))


def frame(marker: int, bits: int, width: int, height: int, channels: int) -> bytes:
    body = struct.pack(">BHHB", bits, height, width, channels) + b"\x01\x11\x00" * channels
    return insert(b"\xff\xd8\xff\xd9", marker, body)


@pytest.mark.parametrize(
    ("header", "error", "says"),
    [
        (frame(0xC0, 8, 60000, 60000, 3), TooManyPixels, "60000 x 60000"),
        (frame(0xC0, 8, 0, 5, 3), DamagedFile, "0 x 5"),
        (frame(0xC0, 8, 5, 0, 3), DamagedFile, "5 x 0"),
        (frame(0xC0, 8, 5, 5, 4), UnknownFormat, "4 components"),
        (frame(0xC1, 12, 5, 5, 1), UnknownFormat, "12 bits"),
        (frame(0xC3, 8, 5, 5, 1), UnknownFormat, "coding 3"),
        (b"\xff\xd8\xff\xd9", DamagedFile, "no frame header"),
    ],
)
def test_the_frame_header_decides_before_anything_is_decoded(header, error, says):
    with pytest.raises(error, match=says):
        decode_image(header, "left", LIMIT)


def test_a_second_frame_too_many_scans_and_too_many_segments_are_refused():
    data = jpeg(scene(16, 16), KINDS["progressive"])
    scan, start = data.rindex(b"\xff\xda"), data.index(b"\xff\xc2")
    with pytest.raises(DamagedFile, match="several frame headers"):
        decode_image(data[:start] + data[start : start + 19] * 2 + data[start + 19 :], "left", LIMIT)
    with pytest.raises(DamagedFile, match="expected 1 to 32"):
        decode_image(data[:scan] + data[scan:-2] * 100 + data[-2:], "left", LIMIT)
    with pytest.raises(DamagedFile, match="10000 segments"):
        decode_image(data[:2] + b"\xff\xfe\0\2" * 10_001 + data[2:], "left", LIMIT)


def test_a_frame_header_whose_length_does_not_fit_its_components_is_damaged():
    body = struct.pack(">BHHB", 8, 5, 5, 3) + b"\x01\x11\x00"
    with pytest.raises(DamagedFile, match="frame header"):
        decode_image(insert(b"\xff\xd8\xff\xd9", 0xC0, body), "left", LIMIT)
