"""Files made to hurt: random damage, and small files that promise or unfold to much."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import time
import zlib
from collections.abc import Callable

import numpy as np
import pytest

from stereomend.codec import decode_disparity, decode_image
from stereomend.disparity import DisparityMap
from stereomend.errors import StereomendError
from stereomend.opencv import cv2

MUTANTS = 1000
LIMIT = 4 * 64 * 48
EXTREMES = [
    struct.pack(order, value) for order in ("<I", ">I", "<H", ">H") for value in (0, 1, 0x7FFF, 0xFFFF)
]
EXTREMES += [struct.pack("<I", 0xFFFFFFFF), struct.pack(">I", 0x7FFFFFFF), b"\x80", b"-", b"9" * 9, b"\n"]


def scene(random: np.random.Generator) -> np.ndarray:
    rows, columns = np.mgrid[0:48, 0:64]
    ramp = np.stack([rows * 3, columns * 2, rows + columns], axis=-1)
    return (ramp + random.integers(1, 30, (48, 64, 3))).astype(np.uint8)


def opencv(ending: str, *options: int) -> Callable[[np.ndarray], bytes]:
    return lambda image: cv2.imencode(ending, image, options)[1].tobytes()


@pytest.fixture
def seed_file(request, random) -> bytes:
    png, npy, pfm, tiff = map(request.getfixturevalue, ("png", "npy", "pfm", "tiff"))
    text = png.chunk(b"tEXt", b"Comment\0" + b"harmless " * 30)
    image = scene(random)
    disparity = image[:, :, 0] / np.float32(4)
    writers = {
        "png": lambda: png(image[:, :, 0].astype(int) * 256, 16, before=text),
        "png interlaced": lambda: png.interlaced(image, 8, 2, before=text),
        "jpeg": lambda: opencv(".jpg")(image),
        "jpeg progressive": lambda: opencv(".jpg", cv2.IMWRITE_JPEG_PROGRESSIVE, 1)(image),
        "tiff": lambda: tiff(disparity, rowsperstrip=7),
        "tiff tiles": lambda: tiff(
            image, tile=(16, 16), compression="zlib", predictor=True, photometric="rgb"
        ),
        "tiff lzw": lambda: opencv(".tiff", cv2.IMWRITE_TIFF_COMPRESSION, 5)(image),
        "npy": lambda: npy(disparity),
        "pfm": lambda: pfm(disparity),
        "bmp": lambda: opencv(".bmp")(image[:, :, 0]),
        "pnm": lambda: opencv(".ppm")(image),
    }
    return writers[request.param]()


KINDS = ["png", "png interlaced", "jpeg", "jpeg progressive", "tiff", "tiff tiles", "tiff lzw"]
KINDS += ["npy", "pfm", "bmp", "pnm"]


def mutate(random: np.random.Generator, data: bytes) -> bytes:
    """Change one to three places, half of them among the first 300 bytes, where headers are."""
    for _ in range(random.integers(1, 4)):
        at = int(random.integers(min(len(data), random.choice([300, len(data)]))))
        length = int(random.integers(1, 40))
        match random.integers(6):
            case 0:
                data = data[:at]
            case 1:
                data = data[:at] + data[at + length :]
            case 2:
                data = data[:at] + data[at : at + length] + data[at:]
            case 3:
                extreme = EXTREMES[random.integers(len(EXTREMES))]
                data = data[:at] + extreme + data[at + len(extreme) :]
            case _:
                data = data[:at] + random.bytes(1) + data[at + 1 :]
        if not data:
            break
    return data


def repair_png_checksums(data: bytes) -> bytes:
    """Make damage pass the first check, so that what lies behind is tried too."""
    parts, at = [data[:8]], 8
    while at + 12 <= len(data):
        end = at + 8 + min(int.from_bytes(data[at : at + 4], "big"), len(data))
        parts += [data[at:end], zlib.crc32(data[at + 4 : end]).to_bytes(4, "big")]
        at = end + 4
    return b"".join(parts)


def outcome(decode: Callable[..., object], data: bytes, **options: object) -> str:
    """Decode; return the error's name, or nothing after checking what came out."""
    start = time.process_time()
    try:
        decoded = decode(data, "part", LIMIT, **options)
    except StereomendError as caught:
        error, decoded = caught, None
    assert time.process_time() - start < 1
    if decoded is not None:
        check_sane(decoded)
        return ""
    assert str(error).startswith("part: ")
    assert len(str(error)) < 300
    return type(error).__name__


def check_sane(decoded: object) -> None:
    pixels = decoded.values if isinstance(decoded, DisparityMap) else decoded
    assert 0 < pixels.shape[0] * pixels.shape[1] <= LIMIT
    assert pixels.ndim == 2 or pixels.shape[2:] == (3,)
    assert pixels.dtype in ((np.float32,) if isinstance(decoded, DisparityMap) else (np.uint8, np.uint16))


@pytest.mark.parametrize("seed_file", KINDS, indirect=True)
def test_random_damage_is_refused_or_decoded_to_a_sane_picture(seed_file, random):
    outcomes = set()
    for number in range(MUTANTS):
        mutant = mutate(random, seed_file)
        if number % 2 and mutant.startswith(b"\x89PNG"):
            mutant = repair_png_checksums(mutant)
        outcomes |= {outcome(decode_image, mutant), outcome(decode_disparity, mutant)}
        outcomes.add(outcome(decode_disparity, mutant, scale=16.0))
    # The mutants are worth something: some are refused for their type, some as damaged, some pass.
    assert {"", "UnknownFormat", "DamagedFile"} <= outcomes


def stored_in_one_strip(width: int, height: int, compression: int, packed: bytes) -> bytes:
    tags = ((256, width), (257, height), (258, 8), (259, compression), (262, 1), (273, 122))
    tags += ((277, 1), (278, height), (279, len(packed)))
    entries = b"".join(struct.pack("<HHII", code, 4, 1, value) for code, value in tags)
    return struct.pack("<4sIH", b"II*\0", 8, len(tags)) + entries + bytes(4) + packed


def npy_header(text: str) -> bytes:
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text.encode()


def bombs(png) -> dict[str, tuple[bytes, str]]:
    """Return files by name, each with what becomes of it as an image."""
    zeros = zlib.compressobj(level=1)
    unfolds = b"".join(zeros.compress(bytes(1 << 20)) for _ in range(300)) + zeros.flush()
    profile, end = png.chunk(b"iCCP", b"name\0\0" + unfolds), png.chunk(b"IEND", b"")
    bitmap = struct.pack("<IHHIIiiHHIIiiII", 0, 0, 0, 54, 40, 4000, 4000, 1, 24, 0, 0, 0, 0, 0, 0)
    array = "{'descr':'%s','fortran_order':False,'shape':(%d,%d)}"
    many, damaged = "TooManyPixels", "DamagedFile"
    return {
        "PNG of 30000 x 30000": (png.ihdr(30000, 30000) + png.chunk(b"IDAT", unfolds) + end, many),
        "PNG whose pixels unfold to 300 MB": (png.ihdr(64, 48) + png.chunk(b"IDAT", unfolds) + end, damaged),
        "PNG whose profile unfolds to 300 MB": (png(np.ones((48, 64)), before=profile), "decoded"),
        "TIFF whose strip unfolds to 300 MB": (stored_in_one_strip(64, 48, 8, unfolds), "decoded"),
        "TIFF of a million by a million": (stored_in_one_strip(1_000_000, 1_000_000, 8, unfolds), many),
        "TIFF of 16 MB in 4 bytes of LZW": (stored_in_one_strip(4000, 4000, 5, b"\x80\x00\x20\x10"), damaged),
        "NPY of a terabyte": (npy_header(array % ("|u1", 1_000_000, 1_000_000)), many),
        "NPY of 32 MB with none": (npy_header(array % ("<u2", 4000, 4000)), damaged),
        "PFM of 64 MB with none": (b"Pf\n4000 4000\n-1\n", "UnknownFormat"),
        "PPM of 96 MB with none": (b"P6\n4000 4000\n65535\n", damaged),
        "BMP of 48 MB with none": (b"BM" + bitmap, damaged),
    }


MEASURE = """
import json, sys, time
from stereomend.codec import decode_disparity, decode_image
from stereomend.errors import StereomendError

def kilobytes(name):
    line = next(line for line in open("/proc/self/status") if line.startswith(name))
    return int(line.split()[1])

def attempt(decode, data):
    try:
        decode(data, "part", 16_000_000)
    except StereomendError as error:
        return type(error).__name__
    return "decoded"

for path in sys.argv[1:]:
    data = open(path, "rb").read()
    before, start = kilobytes("VmRSS"), time.process_time()
    outcomes = [attempt(decode_image, data), attempt(decode_disparity, data)]
    print(json.dumps([kilobytes("VmHWM") - before, time.process_time() - start, outcomes]))
"""


def test_small_files_that_promise_or_unfold_to_much_cost_little(png, tmp_path):
    files = bombs(png)
    paths = [tmp_path / str(number) for number in range(len(files))]
    for path, (data, _) in zip(paths, files.values(), strict=True):
        path.write_bytes(data)
    # A process of its own, because the high-water mark of memory never falls.
    child = subprocess.run(
        [sys.executable, "-c", MEASURE, *paths], capture_output=True, text=True, check=True
    )
    for (name, (_, expected)), line in zip(files.items(), child.stdout.splitlines(), strict=True):
        grown_kb, seconds, outcomes = json.loads(line)
        assert outcomes[0] == expected, name
        assert outcomes[1] != "decoded", name
        assert grown_kb < 200_000, name
        assert seconds < 1, name
