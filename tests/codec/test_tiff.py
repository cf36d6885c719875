from __future__ import annotations

import struct
import time
import zlib

import numpy as np
import pytest

from stereomend.codec import decode_disparity, decode_image
from stereomend.errors import DamagedFile, InputError, TooManyPixels, UnknownFormat
from stereomend.opencv import cv2

LIMIT = 100_000
SIZES = [(1, 1), (1, 13), (13, 1), (37, 53), (64, 48)]
LAYOUTS = {
    "one strip": {},
    "strips": {"rowsperstrip": 5},
    "tiles": {"tile": (16, 32)},
    "deflate": {"compression": "zlib"},
    "deflate with predictor": {"compression": "zlib", "predictor": True, "rowsperstrip": 3},
    "big-endian": {"byteorder": ">"},
    "big-endian with predictor": {"byteorder": ">", "compression": "zlib", "predictor": True},
    "mirrored": {"extratags": [(274, "H", 1, 4, True)]},
}
LZW, DEFLATE, PACKBITS = 5, 8, 32773
TILE = {"t324": (4, [200]), "t325": (4, [100])}


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_images_that_tifffile_writes_come_back(tiff, random, shape, layout, dtype):
    grey = random.integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)
    data = tiff(grey, photometric="minisblack", **LAYOUTS[layout])
    np.testing.assert_array_equal(decode_image(data, "left", LIMIT), grey)
    colour = random.integers(0, np.iinfo(dtype).max, (*shape, 3), dtype, endpoint=True)
    image = decode_image(tiff(colour, photometric="rgb", **LAYOUTS[layout]), "left", LIMIT)
    assert image.dtype == dtype
    np.testing.assert_array_equal(image, colour)


@pytest.mark.parametrize("layout", ["one strip", "tiles", "deflate", "big-endian"])
def test_channels_may_be_stored_one_after_the_other(tiff, random, layout):
    planes = random.integers(0, 256, (3, 37, 53), np.uint8)
    data = tiff(planes, photometric="rgb", planarconfig="separate", **LAYOUTS[layout])
    np.testing.assert_array_equal(decode_image(data, "left", LIMIT), np.moveaxis(planes, 0, 2))


def test_alpha_is_dropped_from_grey_and_colour(tiff, random):
    options = {"planarconfig": "contig", "extrasamples": ["unassalpha"]}
    grey = random.integers(0, 256, (7, 9, 2), np.uint8)
    image = decode_image(tiff(grey, photometric="minisblack", **options), "left", LIMIT)
    np.testing.assert_array_equal(image, grey[:, :, 0])
    colour = random.integers(0, 256, (7, 9, 4), np.uint8)
    image = decode_image(tiff(colour, photometric="rgb", **options), "left", LIMIT)
    np.testing.assert_array_equal(image, colour[:, :, :3])


@pytest.mark.parametrize("shape", [*SIZES, (36, 53), (300, 301)])
@pytest.mark.parametrize("compression", [LZW, DEFLATE, PACKBITS])
@pytest.mark.parametrize("predictor", [1, 2, 3])
def test_maps_that_libtiff_compresses_come_back(random, shape, compression, predictor):
    disparity = (random.integers(1, 99, shape) / 4).astype(np.float32)
    options = [cv2.IMWRITE_TIFF_COMPRESSION, compression, cv2.IMWRITE_TIFF_PREDICTOR, predictor]
    data = cv2.imencode(".tiff", disparity, options)[1].tobytes()
    np.testing.assert_array_equal(decode_disparity(data, "disparity", LIMIT).values, disparity)


@pytest.mark.parametrize("shape", [*SIZES, (36, 53)])
@pytest.mark.parametrize("compression", [LZW, PACKBITS])
def test_images_that_libtiff_compresses_come_back(random, shape, compression):
    image = random.integers(0, 9, (*shape, 3), np.uint8)
    options = [cv2.IMWRITE_TIFF_COMPRESSION, compression]
    data = cv2.imencode(".tiff", image[:, :, ::-1], options)[1].tobytes()
    np.testing.assert_array_equal(decode_image(data, "left", LIMIT), image)


@pytest.mark.parametrize("dtype", ["float16", "float32", "float64"])
@pytest.mark.parametrize("layout", ["one strip", "strips", "tiles", "deflate", "big-endian"])
def test_float_maps_of_any_width_come_back(tiff, random, dtype, layout):
    disparity = (random.integers(1, 999, (37, 53)) / 8).astype(dtype)
    values = decode_disparity(tiff(disparity, **LAYOUTS[layout]), "disparity", LIMIT).values
    np.testing.assert_array_equal(values, disparity.astype(np.float32))


@pytest.mark.parametrize("options", [{}, {"compression": "zlib", "rowsperstrip": 3}, {"tile": (16, 16)}])
def test_a_file_cut_anywhere_is_refused(tiff, random, options):
    data = tiff(random.integers(0, 256, (7, 9), np.uint8), software=False, **options)
    end = max(len(data.rstrip(b"\0")) - 4, 0)  # tiles are padded with zeros, and tags with their own padding
    for length in range(end):
        with pytest.raises(InputError, match=r"^left: "):
            decode_image(data[:length], "left", LIMIT)


def test_lzw_that_ends_early_is_refused(random):
    image = random.integers(0, 9, (20, 30), np.uint16)
    data = cv2.imencode(".tiff", image, [cv2.IMWRITE_TIFF_COMPRESSION, LZW])[1].tobytes()
    entry = data.index(struct.pack("<HHI", 279, 4, 1))  # StripByteCounts, one LONG
    (size,) = struct.unpack_from("<I", data, entry + 8)
    for kept in range(1, size - 4, 7):
        cut = data[: entry + 8] + struct.pack("<I", kept) + data[entry + 12 :]
        with pytest.raises(DamagedFile):
            decode_image(cut, "left", LIMIT)


def test_several_pages_are_refused(tiff):
    page = np.zeros((5, 6), np.uint8)
    with pytest.raises(UnknownFormat, match="several pages"):
        decode_image(tiff(page, page), "left", LIMIT)


def test_bigtiff_is_refused_by_name(tiff):
    with pytest.raises(UnknownFormat, match="BigTIFF"):
        decode_image(tiff(np.zeros((5, 6), np.uint8), bigtiff=True), "left", LIMIT)


def grey(width: int, height: int, size: int, **changes: tuple) -> list[tuple[int, int, list[int]]]:
    """Tags of an 8-bit grey image in one strip that starts at byte 200; `t259=(3, [5])` changes tag 259."""
    tags = {256: (4, [width]), 257: (4, [height]), 258: (3, [8]), 259: (3, [1]), 262: (3, [1])}
    tags |= {273: (4, [200]), 277: (3, [1]), 278: (4, [height]), 279: (4, [size])}
    tags |= {int(name[1:]): value for name, value in changes.items()}
    return [(code, *tags[code]) for code in sorted(tags) if tags[code]]


def packed(raw_tiff, tags, pixels=bytes(100)):
    return raw_tiff(tags).ljust(200, b"\0") + pixels


def test_the_hand_packed_file_that_the_next_tests_break_is_sound(raw_tiff):
    pixels = bytes(range(100))
    image = decode_image(packed(raw_tiff, grey(10, 10, 100), pixels), "left", LIMIT)
    np.testing.assert_array_equal(image, np.arange(100).reshape(10, 10))


@pytest.mark.parametrize(
    ("changes", "error", "says"),
    [
        ({"t259": (3, [7])}, UnknownFormat, "compression 7"),
        ({"t259": (3, [50000])}, UnknownFormat, "compression 50000"),
        ({"t262": (3, [3])}, UnknownFormat, "photometric interpretation 3"),
        ({"t262": (3, [0])}, UnknownFormat, "photometric interpretation 0"),
        ({"t266": (3, [2])}, UnknownFormat, "reversed bits"),
        ({"t258": (3, [1])}, UnknownFormat, r"\[1\] bits"),
        ({"t258": (3, [12])}, UnknownFormat, r"\[12\] bits"),
        ({"t339": (3, [6])}, UnknownFormat, r"sample format \[6\]"),
        ({"t339": (3, [3])}, UnknownFormat, "floats of 16 to 64"),
        ({"t317": (3, [2])}, UnknownFormat, "predictor 2"),
        ({"t317": (3, [3]), "t259": (3, [8])}, UnknownFormat, "predictor 3"),
        ({"t277": (3, [3])}, UnknownFormat, "3 samples"),
        ({"t277": (3, [60000])}, UnknownFormat, "60000 samples"),
        ({"t256": (4, [0])}, DamagedFile, "0 x 10"),
        ({"t257": ()}, DamagedFile, "10 x 0"),
        ({"t256": (4, [2**32 - 1])}, TooManyPixels, "4294967295 x 10"),
        ({"t278": (4, [0])}, DamagedFile, "without pixels"),
        ({"t278": (4, [1])}, DamagedFile, "need 10"),
        ({"t273": ()}, DamagedFile, "lists 0 strips"),
        ({"t273": (4, [250])}, DamagedFile, "cut off"),
        ({"t273": (4, [2**32 - 1])}, DamagedFile, "cut off"),
        ({"t279": (4, [2**32 - 1])}, DamagedFile, "cut off"),
        ({"t279": (4, [99])}, DamagedFile, "holds 99 bytes; expected 100"),
        ({"t279": (4, [0])}, DamagedFile, "holds 0 bytes"),
        ({"t256": (16, [10])}, DamagedFile, "tag 256 .* type 16"),
        ({"t256": (4, [10, 10])}, DamagedFile, "tag 256 .* 2 values"),
        ({"t322": (4, [2**31]), "t323": (4, [2**31]), **TILE}, DamagedFile, "tiles far"),
        ({"t322": (4, [0]), "t323": (4, [16]), **TILE}, DamagedFile, "without pixels"),
    ],
)  # fmt: skip
def test_directories_that_lie_or_ask_for_more_are_refused(raw_tiff, changes, error, says):
    with pytest.raises(error, match=says):
        decode_image(packed(raw_tiff, grey(10, 10, 100, **changes)), "left", LIMIT)


def test_tags_given_twice_and_pages_that_point_to_themselves_are_refused(raw_tiff):
    twice = [*grey(10, 10, 100), (273, 4, [200])]
    with pytest.raises(DamagedFile, match="twice"):
        decode_image(packed(raw_tiff, twice), "left", LIMIT)
    circle = raw_tiff(grey(10, 10, 100), following=8).ljust(200, b"\0") + bytes(100)
    with pytest.raises(UnknownFormat, match="several pages"):
        decode_image(circle, "left", LIMIT)


def test_strips_that_share_their_bytes_are_refused_in_milliseconds(raw_tiff):
    rows = 60_000
    tags = grey(
        1, rows, 0, t278=(4, [1]), t273=(4, [200] * rows), t279=(4, [2_000_000] * rows), t259=(3, [8])
    )
    data = raw_tiff(tags) + bytes(2_000_000)
    start = time.process_time()
    with pytest.raises(DamagedFile, match="cut off"):
        decode_image(data, "left", LIMIT)
    assert time.process_time() - start < 0.5


@pytest.mark.parametrize("damage", [b"\0", b"\xff"])
def test_damaged_deflate_is_refused(raw_tiff, random, damage):
    pixels = zlib.compress(random.integers(0, 256, 100, np.uint8).tobytes())
    for at in (0, 1, 20, len(pixels) - 1):
        broken = pixels[:at] + bytes([pixels[at] ^ 0x5A]) + pixels[at + 1 :]
        tags = grey(10, 10, len(broken), t259=(3, [8]))
        with pytest.raises(DamagedFile):
            decode_image(packed(raw_tiff, tags, broken + damage), "left", LIMIT)


def test_float_images_are_refused_with_what_came_and_what_is_expected(tiff):
    with pytest.raises(UnknownFormat, match=r"^right: TIFF of float32, 1 channel; expected PNG, JPEG, TIFF"):
        decode_image(tiff(np.ones((5, 6), np.float32)), "right", LIMIT)


def test_colour_is_no_disparity(tiff):
    data = tiff(np.ones((5, 6, 3), np.uint16), photometric="rgb")
    with pytest.raises(UnknownFormat, match="3 channels"):
        decode_disparity(data, "disparity", LIMIT, scale=256.0)
