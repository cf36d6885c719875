"""POST /v1/refine over real HTTP."""

import io
import json
import shutil
import subprocess

import cv2
import numpy as np
import pytest
import tifffile
from plyfile import PlyData

from stereomend.refinement import refine

QUICK = {"gdr": {"warps": 1, "levels": 1}}
CALIBRATION = {"focal_px": 80.0, "baseline_mm": 4.5, "doffs": 0.5}


def read_png(body):
    return cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_UNCHANGED)


def read_pfm(body):
    kind, size, scale, pixels = body.split(b"\n", 3)
    assert (kind, float(scale)) == (b"Pf", -1.0)
    width, height = map(int, size.split())
    return np.frombuffer(pixels, "<f4").reshape(height, width)[::-1]


READERS = {
    "image/png": lambda body: read_png(body) / 256,
    "application/x-npy": lambda body: np.load(io.BytesIO(body), allow_pickle=False),
    "image/x-portable-floatmap": read_pfm,
    "image/tiff": lambda body: tifffile.imread(io.BytesIO(body)),
    "application/zip": lambda body: np.load(io.BytesIO(body), allow_pickle=False)["disparity"],
}


@pytest.mark.parametrize("media_type", READERS)
def test_every_media_type_holds_the_map_that_the_package_computes(server, post, scene, media_type):
    response = post(server, accept=media_type, params=QUICK)
    expected = refine(scene.left, scene.right, scene.disparity, backend="reference", **QUICK)
    assert response.status_code == 200
    assert response.headers["Content-Type"] == media_type
    np.testing.assert_allclose(READERS[media_type](response.content), expected.disparity, atol=1 / 256)


def test_the_preview_is_a_colour_picture(server, post):
    response = post(server, accept="image/png; profile=preview", params=QUICK)
    assert response.headers["Content-Type"] == "image/png; profile=preview"
    picture = read_png(response.content)
    assert picture.shape[2] == 3
    assert picture.std(axis=2).max() > 0
    assert picture.dtype == np.uint8


def test_a_png_of_16_bits_is_the_default(server, post):
    response = post(server, accept="*/*", params=QUICK)
    assert response.headers["Content-Type"] == "image/png"
    assert read_png(response.content).dtype == np.uint16


def test_every_stage_is_timed(server, post, stages):
    header = post(server, params={"stages": ["ldr"]}).headers["Server-Timing"]
    timings = dict(entry.split(";dur=") for entry in header.split(", "))
    assert list(timings) == stages
    assert float(timings["gdr"]) == 0
    assert float(timings["ldr"]) > 0
    assert sum(float(timings[name]) for name in stages[:-1]) <= float(timings["total"])


def test_the_meta_header_is_one_short_line_of_ascii(server, post):
    header = post(server, params=QUICK).headers["Stereomend-Meta"]
    meta = json.loads(header)
    assert header.isascii()
    assert len(header) < 4096
    assert {"version", "kernel", "preset", "backend", "quality"} <= meta.keys()


def test_the_zip_carries_its_meta_inside(server, post):
    response = post(server, accept="application/zip", params=QUICK)
    with np.load(io.BytesIO(response.content), allow_pickle=False) as archive:
        assert json.loads(str(archive["meta"]))["backend"] == "reference"
        assert set(archive.files) == {"disparity", "confidence", "provenance", "input_confidence", "meta"}
    assert "Stereomend-Meta" not in response.headers


def test_outputs_pick_the_arrays_of_the_zip(server, post):
    response = post(server, accept="application/zip", params=QUICK | {"outputs": ["confidence"]})
    with np.load(io.BytesIO(response.content), allow_pickle=False) as archive:
        assert set(archive.files) == {"confidence", "meta"}


def test_a_mask_says_what_is_not_part_of_the_scene(server, post, scene, as_npy):
    mask = np.indices(scene.disparity.shape)[1] > 9
    picture = cv2.imencode(".png", mask.astype(np.uint8) * 255)[1].tobytes()
    expected = refine(scene.left, scene.right, scene.disparity, mask=mask, backend="reference", **QUICK)
    for sent in (picture, as_npy(mask)):
        response = post(server, accept="application/zip", params=QUICK, mask=sent)
        with np.load(io.BytesIO(response.content), allow_pickle=False) as archive:
            for name in ("disparity", "confidence", "provenance", "input_confidence"):
                np.testing.assert_array_equal(archive[name], getattr(expected, name))
            assert (archive["provenance"][:, :10] == 3).all()


def test_a_calibration_brings_depth(server, post):
    response = post(server, accept="application/zip", params=QUICK | CALIBRATION)
    with np.load(io.BytesIO(response.content), allow_pickle=False) as archive:
        expected = 80.0 * 4.5 / (archive["disparity"].astype(float) + 0.5)
        np.testing.assert_allclose(archive["depth_mm"], expected, rtol=1e-6)
        meta = json.loads(str(archive["meta"]))
    assert meta["calibration"] == CALIBRATION | {"cx": 31.5, "cy": 23.5}


def test_a_point_cloud_has_the_colours_of_the_left_image(server, post, scene):
    response = post(server, accept="application/ply", params=QUICK | CALIBRATION)
    assert response.headers["Content-Type"] == "application/ply"
    assert json.loads(response.headers["Stereomend-Meta"])["calibration"]["focal_px"] == 80
    expected = refine(scene.left, scene.right, scene.disparity, backend="reference", **QUICK | CALIBRATION)
    vertex = PlyData.read(io.BytesIO(response.content))["vertex"]
    np.testing.assert_array_equal(vertex["z"], expected.depth_mm.ravel())
    colours = np.stack([vertex[channel] for channel in ("red", "green", "blue")], axis=1)
    np.testing.assert_array_equal(colours, scene.left.reshape(-1, 3))


def test_params_may_also_come_as_a_file(server, post):
    as_file = post(server, params=json.dumps(QUICK).encode())
    assert as_file.content == post(server, params=QUICK).content


def test_without_a_disparity_the_matcher_starts(server, post):
    response = post(server, params=QUICK, disparity=None)
    assert json.loads(response.headers["Stereomend-Meta"])["initial"] == "sgbm"
    assert response.status_code == 200


@pytest.mark.skipif(not shutil.which("curl"), reason="needs curl")
def test_curl_gets_the_same_bytes(server, post, scene, tmp_path):
    for name, content in scene.files.items():
        (tmp_path / name).write_bytes(content)
    forms = [f"-F{name}=@{tmp_path / name}" for name in scene.files] + [f"-Fparams={json.dumps(QUICK)}"]
    curl = ["curl", "-sS", "-H", "Accept: application/x-npy", *forms, f"{server.url}/v1/refine"]
    assert subprocess.run(curl, check=True, capture_output=True).stdout == post(server, params=QUICK).content


def test_a_sane_request_id_is_echoed(server, post):
    assert (
        post(server, params=QUICK, headers={"X-Request-ID": "frame-17"}).headers["X-Request-ID"] == "frame-17"
    )


@pytest.mark.parametrize("given", ["", "two words", "x" * 129, "<script>"])
def test_an_odd_request_id_is_replaced(server, post, given):
    response = post(server, params=QUICK, headers={"X-Request-ID": given})
    assert len(response.headers["X-Request-ID"]) == 32


def test_the_log_has_one_line_per_request_and_no_names_of_files(serving, post, scene):
    with serving(log_format="json") as server:
        post(server, params=QUICK, headers={"X-Request-ID": "frame-18"})
        post(server, params=QUICK, left=b"nonsense", headers={"X-Request-ID": "frame-19"})
    text = server.log.read_text()
    lines = [json.loads(line) for line in text.splitlines()]
    found = [line for line in lines if line.get("request_id") in ("frame-18", "frame-19")]
    assert [(line["method"], line["route"], line["status"]) for line in found] == [
        ("POST", "/v1/refine", 200),
        ("POST", "/v1/refine", 415),
    ]
    assert all(line["ms"] > 0 for line in found)
    assert "disparity" not in text
