from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest

from stereomend.codec import decode_disparity, decode_image
from stereomend.errors import DamagedFile, InvalidParameter, ShapeMismatch, UnknownFormat
from stereomend.opencv import cv2

LIMIT = 10_000


def test_sixteen_bit_png_is_divided_by_256_and_zero_is_unknown(png):
    disparity = decode_disparity(png(np.array([[0, 1, 256], [65535, 384, 128]]), 16), "disparity", LIMIT)
    np.testing.assert_array_equal(disparity.values, [[0, 1 / 256, 1], [65535 / 256, 1.5, 0.5]])
    np.testing.assert_array_equal(disparity.valid, [[False, True, True], [True, True, True]])
    assert disparity.values.dtype == np.float32


@pytest.mark.parametrize("scale", [1.0, 3.0, 16.0, 100.0])
def test_a_scale_replaces_the_default(png, random, scale):
    stored = random.integers(0, 1 << 16, (5, 7))
    values = decode_disparity(png(stored, 16), "disparity", LIMIT, scale).values
    np.testing.assert_array_equal(values, (stored / scale).astype(np.float32))


def integers(kind: str, png, npy, tiff) -> bytes:
    stored = np.array([[0, 8, 100], [120, 4, 60]])
    if kind == "png8":
        return png(stored)
    return npy(stored.astype(kind[3:])) if kind.startswith("npy") else tiff(stored.astype(kind[4:]))


KINDS = ["png8", "npyu1", "npyi2", "npy>u4", "npyi8", "tiffu1", "tiffu2", "tiffi4"]


@pytest.mark.parametrize("scale", [1.0, 3.0, 255.0, 256.0, 0.1, 1000 / 3, 16777217.0])
def test_every_quotient_is_rounded_once(png, scale):
    stored = np.arange(1 << 16, dtype=np.uint16).reshape(256, 256)
    values = decode_disparity(png(stored, 16), "disparity", stored.size, scale).values
    np.testing.assert_array_equal(values, (stored / np.float64(scale)).astype(np.float32))


@pytest.mark.parametrize("kind", KINDS)
def test_other_integers_need_a_scale_and_the_message_says_its_name(png, npy, tiff, kind):
    data = integers(kind, png, npy, tiff)
    with pytest.raises(InvalidParameter, match=r"^disparity: disparity_scale is missing"):
        decode_disparity(data, "disparity", LIMIT)
    values = decode_disparity(data, "disparity", LIMIT, 4.0).values
    np.testing.assert_array_equal(values, [[0, 2, 25], [30, 1, 15]])


@pytest.mark.parametrize("kind", ["npy", "pfm", "tiff"])
def test_a_scale_for_floats_is_refused_rather_than_guessed(npy, pfm, tiff, kind):
    floats = np.ones((2, 3), np.float32)
    data = {"npy": npy(floats), "pfm": pfm(floats), "tiff": tiff(floats)}[kind]
    with pytest.raises(
        InvalidParameter, match=r"disparity_scale is 256, but a .* of float32 holds pixels already"
    ):
        decode_disparity(data, "disparity", LIMIT, 256.0)


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scale_must_be_a_finite_number_above_zero(png, scale):
    with pytest.raises(InvalidParameter, match="disparity_scale"):
        decode_disparity(png(np.ones((2, 2)), 16), "disparity", LIMIT, scale)


def test_what_is_not_finite_or_not_positive_is_unknown(npy):
    stored = np.array([[np.nan, np.inf, -np.inf], [-1, 0, 2.5], [1e300, -1e300, 5e-324]])
    disparity = decode_disparity(npy(stored), "disparity", LIMIT)
    np.testing.assert_array_equal(disparity.values, [[0, 0, 0], [0, 0, 2.5], [0, 0, 0]])
    stored = np.array([[-16, 0, 24]], np.int16)
    np.testing.assert_array_equal(
        decode_disparity(npy(stored), "disparity", LIMIT, 16.0).values, [[0, 0, 1.5]]
    )


def test_quotients_that_overflow_are_unknown(npy):
    stored = np.full((1, 2), 2**63 - 1)
    assert not decode_disparity(npy(stored), "disparity", LIMIT, 1e-300).valid.any()


@pytest.mark.parametrize(
    ("colour", "channels"), [(2, 3), (3, 1), (4, 2), (6, 4)], ids=["RGB", "palette", "grey+A", "RGB+A"]
)
def test_a_png_with_more_than_one_channel_is_no_disparity(png, colour, channels):
    palette = png.chunk(b"PLTE", bytes(768)) if colour == 3 else b""
    data = png(np.squeeze(np.ones((2, 3, channels), int)), 8, colour, before=palette)
    with pytest.raises(UnknownFormat, match=r"PNG of 8-bit, \d channels; expected 16-bit PNG"):
        decode_disparity(data, "disparity", LIMIT, 256.0)


@pytest.mark.parametrize("depth", [1, 2, 4])
def test_a_png_with_less_than_eight_bits_is_no_disparity(png, depth):
    with pytest.raises(UnknownFormat, match=f"{depth}-bit, 1 channel;"):
        decode_disparity(png(np.ones((2, 3)), depth), "disparity", LIMIT, 1.0)


@pytest.mark.parametrize("ending", [".jpg", ".bmp", ".pgm"])
def test_formats_for_pictures_are_no_disparity(ending):
    data = cv2.imencode(ending, np.ones((4, 6), np.uint8))[1].tobytes()
    assert decode_image(data, "left", LIMIT).shape == (4, 6)
    with pytest.raises(UnknownFormat, match="expected 16-bit PNG, NPY, PFM"):
        decode_disparity(data, "disparity", LIMIT, 1.0)


def archive() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as writer:
        writer.writestr("disparity.npy", b"")
    return file.getvalue()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (archive(), "ZIP archive"),
        (b"%PDF-1.7\n", "PDF"),
        (b"<!DOCTYPE html><html>", "HTML"),
        (b"GIF89a" + bytes(20), "GIF"),
        (b"\x76\x2f\x31\x01" + bytes(20), "OpenEXR"),
        (bytes(128) + b"DICM" + bytes(20), "DICOM"),
        (b"\x80\x04\x95" + bytes(20), "pickle"),
        (b"P2\n1 1\n255\n7\n", "PNM that is text"),
        (b"patient: secret name", r"starts with the bytes 70 61 74 69 65 6e 74 3a"),
        (b"\0", "starts with the bytes 00"),
    ],
)
def test_other_files_are_refused_with_what_came_and_what_is_expected(data, says):
    with pytest.raises(UnknownFormat, match=f"^left: .*{says}.*; expected PNG, JPEG, TIFF") as caught:
        decode_image(data, "left", LIMIT)
    assert "secret" not in str(caught.value)
    with pytest.raises(UnknownFormat, match=f"^disparity: .*{says}.*; expected 16-bit PNG"):
        decode_disparity(data, "disparity", LIMIT)


def test_an_empty_file_says_so():
    with pytest.raises(DamagedFile, match=r"^left: the file is empty"):
        decode_image(b"", "left", LIMIT)
    with pytest.raises(DamagedFile, match=r"^disparity: the file is empty"):
        decode_disparity(b"", "disparity", LIMIT)


def test_what_decoders_raise_unforeseen_becomes_a_damaged_file(png, monkeypatch):
    def broken(*_: object) -> None:
        raise ShapeMismatch("kept") if kept else ZeroDivisionError("secret")

    monkeypatch.setattr(cv2, "imdecode", broken)
    kept = False
    with pytest.raises(DamagedFile, match=r"^left: cannot be decoded \(ZeroDivisionError\)$"):
        decode_image(png(np.ones((2, 2)), 1), "left", LIMIT)
    kept = True
    with pytest.raises(ShapeMismatch, match=r"^left: kept$"):
        decode_image(png(np.ones((2, 2)), 1), "left", LIMIT)
