from __future__ import annotations

import io
import json
import zipfile
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
import tifffile

from stereomend.codec import (
    MEDIA_TYPES,
    PREVIEW_TYPE,
    decode_disparity,
    encode_result,
    media_type_for,
)
from stereomend.disparity import RefinementResult
from stereomend.errors import DisparityOutOfRange, InvalidParameter, NotAcceptable
from stereomend.opencv import cv2

SIZES = [(1, 1), (1, 13), (13, 1), (37, 53)]
UNCALIBRATED = ("disparity", "confidence", "provenance", "input_confidence")
PNG, NPY, PFM, TIFF, ZIP = (MEDIA_TYPES[ending] for ending in (".png", ".npy", ".pfm", ".tiff", ".npz"))


def result_of(disparity: np.ndarray, meta: dict | None = None) -> RefinementResult:
    disparity = np.asarray(disparity, np.float32)
    random = np.random.default_rng(3)
    return RefinementResult(
        disparity,
        random.random(disparity.shape, np.float32),
        random.integers(0, 4, disparity.shape, np.uint8),
        random.random(disparity.shape, np.float32),
        timings={"gdr": 12.5, "total": 20.0},
        meta=MappingProxyType(meta or {}),
    )


@pytest.fixture(params=SIZES, ids=str)
def disparity(request, random):
    return (random.random(request.param) * 200 + 0.01).astype(np.float32)


def test_png_holds_disparity_times_256_in_16_bits(disparity):
    stored = cv2.imdecode(
        np.frombuffer(encode_result(result_of(disparity), PNG), np.uint8), cv2.IMREAD_UNCHANGED
    )
    assert stored.dtype == np.uint16
    np.testing.assert_array_equal(stored, np.rint(disparity.astype(np.float64) * 256))


def test_png_keeps_zero_free_because_every_result_is_known():
    data = encode_result(result_of([[0, 1e-9, 1 / 256, 1.5 / 256 + 1e-6]]), PNG)
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), -1), [[1, 1, 1, 2]])


def test_png_rounds_halves_to_even_up_to_the_largest_level():
    levels = np.arange(1, 65535, dtype=np.float32)[None, ::-7]
    data = encode_result(result_of((levels + np.float32(0.5)) / 256), PNG)
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), -1), np.rint(levels + 0.5))


def test_png_refuses_what_does_not_fit_and_names_what_does():
    largest = np.float32(65535 / 256)
    data = encode_result(result_of([[1, largest]]), PNG)
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), -1), [[256, 65535]])
    with pytest.raises(DisparityOutOfRange, match=r"300\.5 px.* 255\.996 px; NPY .* TIFF"):
        encode_result(result_of([[1, 300.5]]), PNG)
    with pytest.raises(DisparityOutOfRange):
        encode_result(result_of([[65535.5 / 256]]), PNG)
    with pytest.raises(DisparityOutOfRange):
        encode_result(result_of([[1, np.finfo(np.float32).max]]), PNG)


def test_npy_is_what_numpy_loads(disparity):
    loaded = np.load(io.BytesIO(encode_result(result_of(disparity), NPY)))
    assert loaded.dtype == np.float32
    np.testing.assert_array_equal(loaded, disparity)


def test_tiff_is_one_page_of_float32(disparity):
    with tifffile.TiffFile(io.BytesIO(encode_result(result_of(disparity), TIFF))) as file:
        assert len(file.pages) == 1
        assert file.pages[0].dtype == np.float32
        np.testing.assert_array_equal(file.pages[0].asarray(), disparity)


def test_pfm_is_little_endian_and_starts_with_the_bottom_row():
    data = encode_result(result_of([[1, 2, 3], [4, 5, 6]]), PFM)
    assert data == b"Pf\n3 2\n-1.0\n" + np.array([4, 5, 6, 1, 2, 3], "<f4").tobytes()


@pytest.mark.parametrize("media_type", [NPY, PFM, TIFF])
def test_what_is_written_reads_back_exactly(disparity, media_type):
    data = encode_result(result_of(disparity), media_type)
    np.testing.assert_array_equal(decode_disparity(data, "disparity", 10_000).values, disparity)


def test_maps_that_are_views_are_written_like_others(random):
    wide = (random.random((20, 30)) + 1).astype(np.float32)
    view = wide[::-1, ::3]
    for media_type in (NPY, PFM, TIFF):
        data = encode_result(result_of(view), media_type)
        np.testing.assert_array_equal(decode_disparity(data, "disparity", 10_000).values, view)


def test_zip_is_what_numpy_loads_with_meta_as_json(disparity):
    meta = {"version": "1.2", "quality": MappingProxyType({"kept": np.float32(0.5), "warnings": ()})}
    result = result_of(disparity, meta)
    with np.load(io.BytesIO(encode_result(result, ZIP)), allow_pickle=False) as arrays:
        assert set(arrays) == {*UNCALIBRATED, "meta"}
        for name in UNCALIBRATED:
            assert arrays[name].dtype == getattr(result, name).dtype
            np.testing.assert_array_equal(arrays[name], getattr(result, name))
        assert arrays["meta"].shape == ()
        assert json.loads(str(arrays["meta"])) == {
            "version": "1.2",
            "quality": {"kept": 0.5, "warnings": []},
            "timings_ms": {"gdr": 12.5, "total": 20.0},
        }


def test_outputs_pick_the_arrays_of_a_zip_and_meta_is_always_there(disparity):
    data = encode_result(result_of(disparity), ZIP, ["provenance"])
    assert zipfile.ZipFile(io.BytesIO(data)).namelist() == ["meta.npy", "provenance.npy"]
    with pytest.raises(InvalidParameter, match="depth_mm"):
        encode_result(result_of(disparity), ZIP, ["disparity", "depth_mm"])


def test_a_calibrated_result_has_its_depth_in_the_zip(disparity):
    result = replace(result_of(disparity), depth_mm=900 / disparity)
    for outputs in (None, ["depth_mm"]):
        with np.load(io.BytesIO(encode_result(result, ZIP, outputs))) as arrays:
            np.testing.assert_array_equal(arrays["depth_mm"], 900 / disparity)
            assert ("disparity" in arrays) == (outputs is None)


def test_meta_that_is_no_json_is_a_fault_not_a_file(disparity):
    with pytest.raises(TypeError, match="set"):
        encode_result(result_of(disparity, {"levels": {1}}), ZIP)


def test_preview_is_an_8_bit_colour_png(disparity):
    picture = cv2.imdecode(np.frombuffer(encode_result(result_of(disparity), PREVIEW_TYPE), np.uint8), -1)
    assert picture.dtype == np.uint8
    assert picture.shape[2] == 3
    assert picture.shape[0] == max(disparity.shape[0], 96)


def test_other_media_types_are_not_acceptable(disparity):
    with pytest.raises(NotAcceptable, match="image/webp; offered are image/png"):
        encode_result(result_of(disparity), "image/webp")


@pytest.mark.parametrize(
    ("path", "media_type"),
    [
        ("a.png", "image/png"),
        ("dir.npy/A.NPY", "application/x-npy"),
        ("a.npz", "application/zip"),
        ("a.pfm", "image/x-portable-floatmap"),
        ("a.tif", "image/tiff"),
        ("a.b.TIFF", "image/tiff"),
        ("a.ply", "application/ply"),
    ],
)
def test_the_ending_of_a_file_chooses_the_media_type(path, media_type):
    assert media_type_for(path) == media_type


@pytest.mark.parametrize("path", ["a.jpg", "a", "png", ".npy/a"])
def test_other_endings_are_refused_with_those_offered(path):
    with pytest.raises(InvalidParameter, match=r"\.png, \.npy, \.npz, \.pfm, \.tiff, \.tif, \.ply$"):
        media_type_for(path)
