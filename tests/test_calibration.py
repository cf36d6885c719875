"""Depth and points, against both cameras."""

import numpy as np
import pytest

from stereomend import Calibration, refine
from stereomend.errors import InvalidParameter
from stereomend.phantom import make_phantom
from stereomend.refinement import parse_params

KNOWN = {"focal_px": 250.0, "baseline_mm": 4.5}


@pytest.fixture(scope="module")
def phantom():
    return make_phantom(2, 96, 64)


def projected(point, calibration, camera_at, centre):
    """Where a pinhole camera at x = `camera_at` mm sees a point (X, Y, Z) mm: column and row in px."""
    x, y, z = np.moveaxis(point.astype(float), -1, 0)
    f = calibration.focal_px
    return f * (x - camera_at) / z + centre, f * y / z + calibration.cy


@pytest.mark.parametrize("doffs", [0.0, 11.5, -2.0])
def test_points_are_seen_by_both_cameras_where_the_disparity_says(doffs):
    calibration = Calibration(250.0, 4.5, cx=30.25, cy=7.0, doffs=doffs)
    disparity = np.random.default_rng(0).uniform(3, 20, (13, 60)).astype(np.float32)
    points = calibration.points_mm(calibration.depth_mm(disparity))
    rows, columns = np.indices(disparity.shape)
    in_left = projected(points, calibration, 0.0, calibration.cx)
    in_right = projected(points, calibration, calibration.baseline_mm, calibration.cx + doffs)
    np.testing.assert_allclose(in_left, (columns, rows), atol=1e-3)
    np.testing.assert_allclose(in_right, (columns - disparity, rows), atol=1e-3)


def test_depth_that_cannot_be_told_is_zero():
    disparity = np.array([[0, 1, 2, 3, 1e-40]], np.float32)
    assert Calibration(500, 4, 0, 0, doffs=-2).depth_mm(disparity).tolist() == [[0, 0, 0, 2000, 0]]
    assert Calibration(500, 4, 0, 0).depth_mm(disparity)[0, [0, 1, 4]].tolist() == [0, 2000, 0]


def test_a_calibrated_result_has_the_depth_of_its_disparity(phantom):
    given = {"focal_px": phantom.focal_px, "baseline_mm": phantom.baseline_mm}
    result = refine(phantom.pair.left, phantom.pair.right, phantom.truth, preset="released", **given)
    expected = phantom.focal_px * phantom.baseline_mm / result.disparity.astype(float)
    np.testing.assert_allclose(result.depth_mm, expected, rtol=1e-6)
    assert result.depth_mm.dtype == np.float32
    assert result.calibration == Calibration(**given, cx=47.5, cy=31.5)


def test_without_a_calibration_there_is_no_depth(phantom):
    result = refine(phantom.pair.left, phantom.pair.right, phantom.truth, stages=["ldr"])
    assert result.depth_mm is None
    assert result.calibration is None


def test_the_principal_point_and_the_offset_can_be_given():
    params = parse_params(KNOWN | {"cx": 0, "cy": -3.5, "doffs": 2})
    assert params.calibration((64, 96)) == Calibration(250, 4.5, 0, -3.5, 2)


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"focal_px": 100}, "baseline_mm is missing.*focal_px and baseline_mm"),
        ({"baseline_mm": 4}, "focal_px is missing"),
        (KNOWN | {"focal_px": 0}, "focal_px.*got 0"),
        (KNOWN | {"baseline_mm": -4}, "baseline_mm.*got -4"),
        (KNOWN | {"cx": float("nan")}, "cx"),
        ({"outputs": ["depth_mm"]}, "depth_mm needs focal_px and baseline_mm"),
        ({"outputs": []}, "outputs"),
    ],
)
def test_half_a_calibration_is_refused(given, named):
    with pytest.raises(InvalidParameter, match=named):
        parse_params(given)
