"""Files made to hurt: random damage, and small files that promise or unfold to much."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import zlib

import numpy as np
import pytest
from trials.decoding import decode_mutants
from trials.originals import FORMATS, originals

from stereomend.codec import decode_disparity, decode_image, decode_mask
from stereomend.disparity import DisparityMap
from stereomend.errors import InvalidParameter

MUTANTS = 300
MOST_GROWTH_MB = 200


@pytest.mark.parametrize("format", FORMATS, ids=str)
def test_damaged_files_are_refused_or_decoded_in_little_time_and_memory(format):
    found = decode_mutants(format, range(MUTANTS), seed=2)
    assert not found.faults | found.crashes
    assert found.mutants == MUTANTS
    assert found.grown_mb < MOST_GROWTH_MB
    # The mutants are worth something: some are refused for their type, some as damaged, some pass.
    assert {"decoded", "UnknownFormat", "DamagedFile"} <= set(found.outcomes)


@pytest.mark.parametrize("format", FORMATS, ids=str)
def test_the_files_that_are_damaged_were_sound(format):
    decode = {"image": decode_image, "map": decode_any_map, "mask": decode_mask}[format.part]
    for original in originals(format):
        decoded = decode(original.data, "part", 64 * 48)
        pixels = decoded.values if isinstance(decoded, DisparityMap) else decoded
        assert pixels.shape[:2] == original.shape


def decode_any_map(data: bytes, name: str, max_pixels: int) -> DisparityMap:
    try:
        return decode_disparity(data, name, max_pixels)
    except InvalidParameter:
        return decode_disparity(data, name, max_pixels, 16)


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
