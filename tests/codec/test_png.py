from __future__ import annotations

import struct
import time
import zlib

import numpy as np
import pytest

from stereomend.codec import decode_image
from stereomend.errors import DamagedFile, InputError, TooManyPixels, UnknownFormat

SIZES = [(1, 1), (1, 13), (13, 1), (3, 5), (37, 53)]
LIMIT = 10_000


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("kind", [(0, 1), (2, 3), (4, 2), (6, 4)], ids=["grey", "RGB", "grey+A", "RGB+A"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_samples_come_back_as_packed_without_alpha(png, random, shape, kind, dtype):
    (colour, channels), depth = kind, 8 * np.dtype(dtype).itemsize
    samples = random.integers(0, 1 << depth, (*shape, channels))
    image = decode_image(png(samples, depth, colour), "left", LIMIT)
    assert image.dtype == dtype
    np.testing.assert_array_equal(image, samples[..., 0] if channels <= 2 else samples[..., :3])


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize(("depth", "step"), [(1, 255), (2, 85), (4, 17)])
def test_fewer_than_eight_bits_are_spread_to_eight(png, random, shape, depth, step):
    samples = random.integers(0, 1 << depth, shape)
    image = decode_image(png(samples, depth), "left", LIMIT)
    assert image.dtype == np.uint8
    np.testing.assert_array_equal(image, samples * step)


@pytest.mark.parametrize("depth", [1, 2, 4, 8])
def test_palettes_are_expanded_to_rgb_even_if_they_are_grey_or_transparent(png, random, depth):
    colours = np.repeat(random.integers(0, 256, (1 << depth, 1), dtype=np.uint8), 3, axis=1)
    colours[0] = 1, 2, 3
    indices = random.integers(0, 1 << depth, (5, 11))
    tables = png.chunk(b"PLTE", colours.tobytes()) + png.chunk(b"tRNS", b"\0\x80")
    image = decode_image(png(indices, depth, 3, before=tables), "left", LIMIT)
    np.testing.assert_array_equal(image, colours[indices])


def test_transparency_profiles_gamma_orientation_and_animation_change_nothing(png, random):
    samples = random.integers(0, 256, (9, 14))
    rotated = b"MM\0*" + struct.pack(">IHHHIHHI", 8, 1, 274, 3, 1, 6, 0, 0)
    others = (
        png.chunk(b"tRNS", struct.pack(">H", int(samples[0, 0])))
        + png.chunk(b"gAMA", struct.pack(">I", 100000))
        + png.chunk(b"eXIf", rotated)
        + png.chunk(b"iCCP", b"name\0\0" + zlib.compress(bytes(100)))
        + png.chunk(b"acTL", struct.pack(">II", 2, 0))
    )
    np.testing.assert_array_equal(decode_image(png(samples, before=others), "left", LIMIT), samples)


@pytest.mark.parametrize("shape", [*SIZES, (8, 8), (9, 17), (2, 3), (5, 4)])
def test_interlaced_files_hold_the_same_picture(png, random, shape):
    grey = random.integers(0, 1 << 16, shape)
    np.testing.assert_array_equal(decode_image(png.interlaced(grey, 16), "left", LIMIT), grey)
    colour = random.integers(0, 1 << 8, (*shape, 3))
    np.testing.assert_array_equal(decode_image(png.interlaced(colour, 8, 2), "left", LIMIT), colour)


def test_interlaced_bits_are_spread_too(png, random):
    samples = random.integers(0, 2, (11, 19))
    np.testing.assert_array_equal(decode_image(png.interlaced(samples, 1), "left", LIMIT), samples * 255)


def test_pixels_may_be_split_over_many_chunks_and_bytes_may_follow_the_end(png, random):
    samples = random.integers(0, 256, (21, 34))
    np.testing.assert_array_equal(decode_image(png(samples, piece=7) + b"more", "left", LIMIT), samples)


def test_a_file_cut_anywhere_is_refused(png, random):
    data = png(random.integers(0, 256, (7, 9, 3)), colour=2, piece=40)
    for length in range(len(data)):
        with pytest.raises(InputError, match=r"^left: "):
            decode_image(data[:length], "left", LIMIT)


def test_a_flipped_bit_anywhere_is_noticed(png, random):
    data = png(random.integers(0, 256, (7, 9)))
    for at in range(len(data)):
        flipped = data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :]
        with pytest.raises(InputError):
            decode_image(flipped, "left", LIMIT)


@pytest.mark.parametrize(
    ("packed", "says"),
    [
        (zlib.compress(bytes(5 * 4 - 1)), "holds 19 bytes"),
        (zlib.compress(bytes(5 * 4 + 1)), "more than the 20 bytes"),
        (zlib.compress(bytes(5 * 4))[:-4], "holds 20 bytes"),
        (zlib.compress(bytes(5 * 4))[:-1] + b"?", "damaged"),
        (zlib.compress(b"\x09" + bytes(5 * 4 - 1)), "cannot be decoded"),
        (b"", "holds 0 bytes"),
    ],
    ids=["short", "long", "no checksum", "wrong checksum", "unknown filter", "none"],
)
def test_pixels_that_do_not_fill_the_promised_size_are_refused(png, packed, says):
    data = png.ihdr(4, 4) + png.chunk(b"IDAT", packed) + png.chunk(b"IEND", b"")
    with pytest.raises(DamagedFile, match=says):
        decode_image(data, "left", LIMIT)


def test_bytes_after_the_pixels_within_a_chunk_are_passed_over_quickly(png, random):
    samples = random.integers(0, 256, (21, 34))
    packed = zlib.compress(png.rows(samples, 8)) + bytes(16_000_000)
    data = png.ihdr(34, 21) + png.chunk(b"IDAT", packed) + png.chunk(b"IEND", b"")
    start = time.process_time()
    np.testing.assert_array_equal(decode_image(data, "left", LIMIT), samples)
    assert time.process_time() - start < 0.5


def test_a_huge_picture_in_a_small_file_is_refused_in_milliseconds(png):
    packed = zlib.compress(bytes(1_000_000)) * 900
    data = png.ihdr(30000, 30000) + png.chunk(b"IDAT", packed) + png.chunk(b"IEND", b"")
    start = time.process_time()
    with pytest.raises(TooManyPixels, match=r"^right: 30000 x 30000 .* 16000000$"):
        decode_image(data, "right", 16_000_000)
    assert time.process_time() - start < 0.05


def test_the_limit_counts_pixels_and_is_inclusive(png):
    data = png(np.zeros((10, 10)))
    assert decode_image(data, "left", 100).shape == (10, 10)
    with pytest.raises(TooManyPixels):
        decode_image(data, "left", 99)


def test_a_side_longer_than_opencv_takes_is_too_many_pixels_not_damage(png):
    with pytest.raises(TooManyPixels, match="1048576"):
        decode_image(png(np.zeros((1, (1 << 20) + 1))), "left", 1 << 24)


@pytest.mark.parametrize(
    ("header", "error"),
    [
        ((0, 5, 8, 0, 0), DamagedFile),
        ((5, 0, 8, 0, 0), DamagedFile),
        ((5, 5, 3, 0, 0), DamagedFile),
        ((5, 5, 16, 3, 0), DamagedFile),
        ((5, 5, 8, 1, 0), DamagedFile),
        ((5, 5, 8, 0, 2), DamagedFile),
    ],
)
def test_headers_that_png_does_not_define_are_refused(png, header, error):
    with pytest.raises(error):
        decode_image(png.ihdr(*header) + png.chunk(b"IEND", b""), "left", LIMIT)


def test_unknown_critical_chunks_and_endless_chunks_are_refused(png):
    samples = np.zeros((3, 3))
    with pytest.raises(UnknownFormat, match="critical"):
        decode_image(png(samples, before=png.chunk(b"CgBI", b"")), "left", LIMIT)
    with pytest.raises(DamagedFile, match="100000 chunks"):
        decode_image(png(samples, before=png.chunk(b"teXt", b"") * 100_001), "left", LIMIT)
