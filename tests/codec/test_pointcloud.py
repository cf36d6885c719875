"""PLY, read back by another program's reader."""

from __future__ import annotations

import io

import numpy as np
import pytest
from plyfile import PlyData

from stereomend.codec import PLY_TYPE, encode_result
from stereomend.disparity import RefinementResult
from stereomend.errors import InvalidParameter

F, B, CX, CY = 200.0, 5.0, 3.5, 2.0
CALIBRATION = {"focal_px": F, "baseline_mm": B, "cx": CX, "cy": CY, "doffs": 0.0}
PROPERTIES = {
    **dict.fromkeys(("x", "y", "z", "confidence"), "f4"),
    **dict.fromkeys(("red", "green", "blue", "provenance"), "u1"),
}


@pytest.fixture
def result(random):
    shape = (6, 9)
    depth = random.uniform(20, 200, shape).astype(np.float32)
    depth[0, 3] = depth[5] = 0
    return RefinementResult(
        np.ones(shape, np.float32),
        random.random(shape, np.float32),
        random.integers(0, 4, shape, np.uint8),
        np.zeros(shape, np.float32),
        depth,
        meta={"calibration": CALIBRATION},
    )


def vertices(data):
    return PlyData.read(io.BytesIO(data))["vertex"]


def test_every_pixel_of_known_depth_is_a_point_in_front_of_its_pixel(result, random):
    left = random.integers(0, 256, (6, 9, 3), np.uint8)
    cloud = vertices(encode_result(result, PLY_TYPE, left=left))
    assert {prop.name: prop.val_dtype for prop in cloud.properties} == PROPERTIES
    expected = [
        (
            *((x - CX) * z / F, (y - CY) * z / F, z),
            *left[y, x],
            *(result.confidence[y, x], result.provenance[y, x]),
        )
        for y in range(6)
        for x in range(9)
        if (z := float(result.depth_mm[y, x])) > 0
    ]
    assert len(expected) == 44
    names = ("x", "y", "z", "red", "green", "blue", "confidence", "provenance")
    np.testing.assert_allclose(np.stack([cloud[name] for name in names], axis=1), expected, rtol=1e-6)


def test_grey_and_16_bits_become_8_bit_colours(result):
    left = np.arange(54, dtype=np.uint16).reshape(6, 9) * 1200
    cloud = vertices(encode_result(result, PLY_TYPE, left=left))
    for channel in ("red", "green", "blue"):
        np.testing.assert_array_equal(cloud[channel], np.rint(left[result.depth_mm > 0] / 257))


def test_a_cloud_without_points_is_a_file_all_the_same(result):
    result.depth_mm[:] = 0
    assert len(vertices(encode_result(result, PLY_TYPE, left=np.zeros((6, 9), np.uint8))).data) == 0


def test_a_cloud_needs_calibration_and_image(result):
    with pytest.raises(InvalidParameter, match="left image"):
        encode_result(result, PLY_TYPE)
    bare = RefinementResult(result.disparity, result.confidence, result.provenance, result.input_confidence)
    with pytest.raises(InvalidParameter, match="focal_px, baseline_mm"):
        encode_result(bare, PLY_TYPE, left=np.zeros((6, 9), np.uint8))
