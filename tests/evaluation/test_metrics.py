import math

import numpy as np
import pytest

from stereomend.disparity import Calibration
from stereomend.errors import NoValidDisparity, ShapeMismatch
from stereomend.evaluation.metrics import depth_rmse, score

NAN, INF = np.nan, np.inf
TRUTH = np.array([[10, 10, 10, 10], [0, NAN, -1, 20]], np.float32)
GIVEN = np.array([[11.5, 10, NAN, 7], [3, 4, 5, 22.5]], np.float32)
ERRORS = [1.5, 0, 10, 3, 2.5]  # the third has no prediction
RIG = Calibration(focal_px=500, baseline_mm=4, cx=0, cy=0)


def test_errors_count_where_the_truth_is_known():
    scores = score(GIVEN, TRUTH)
    assert scores.pixels == 5
    assert scores.rmse == pytest.approx(math.sqrt(sum(error**2 for error in ERRORS) / 5))
    assert scores.epe == pytest.approx(sum(ERRORS) / 5)
    assert scores.missing == pytest.approx(20)


def test_a_pixel_is_bad_above_the_threshold_and_not_at_it():
    assert score(GIVEN, TRUTH).bad == {1.0: 80.0, 2.0: 60.0, 3.0: 20.0}


@pytest.mark.parametrize("unknown", [0, -3, NAN, INF, -INF])
def test_an_unknown_prediction_counts_as_disparity_0(unknown):
    scores = score(np.full((3, 5), unknown, np.float32), np.full((3, 5), 8, np.float32))
    assert scores.rmse == scores.epe == 8
    assert scores.missing == 100


def test_a_mask_narrows_what_counts():
    counted = np.array([[True, True, False, False], [True, True, True, False]])
    scores = score(GIVEN, TRUTH, counted)
    assert scores.pixels == 2
    assert scores.epe == pytest.approx(0.75)


def test_neither_array_is_changed():
    given, truth = GIVEN.copy(), TRUTH.copy()
    score(given, truth)
    depth_rmse(given, truth, RIG)
    np.testing.assert_array_equal(given, GIVEN)
    np.testing.assert_array_equal(truth, TRUTH)


def test_depth_errors_are_differences_of_f_b_over_d():
    # 2000 / 20 = 100 mm against 2000 / 25 = 80 mm, and 2000 / 40 = 50 mm against itself.
    given, truth = np.float32([[25, 40]]), np.float32([[20, 40]])
    assert depth_rmse(given, truth, RIG) == pytest.approx(math.sqrt(20**2 / 2))


def test_the_offset_of_the_principal_points_shifts_disparity():
    rig = Calibration(500, 4, 0, 0, doffs=10)
    assert depth_rmse(np.float32([[10]]), np.float32([[30]]), rig) == pytest.approx(2000 / 20 - 2000 / 40)


@pytest.mark.parametrize("doffs", [0, 7])
@pytest.mark.parametrize("unknown", [0, NAN, -4])
def test_an_unknown_prediction_counts_as_depth_0(doffs, unknown):
    rig = Calibration(500, 4, 0, 0, doffs)
    expected = 2000 / (10 + doffs)
    assert depth_rmse(np.float32([[unknown]]), np.float32([[10]]), rig) == pytest.approx(expected)


def test_a_pixel_without_true_depth_is_left_out():
    rig = Calibration(500, 4, 0, 0, doffs=-15)  # a truth of 10 px lies beyond infinity
    given, truth = np.float32([[35, 50]]), np.float32([[10, 40]])
    assert depth_rmse(given, truth, rig) == pytest.approx(2000 / 25 - 2000 / 35)


@pytest.mark.parametrize("measure", [score, lambda *maps: depth_rmse(maps[0], maps[1], RIG, *maps[2:])])
def test_without_a_pixel_to_count_there_is_no_score(measure):
    with pytest.raises(NoValidDisparity, match="no counted pixel"):
        measure(GIVEN, np.zeros_like(TRUTH))
    with pytest.raises(NoValidDisparity, match="no counted pixel"):
        measure(GIVEN, TRUTH, np.zeros(TRUTH.shape, bool))
    with pytest.raises(ShapeMismatch, match="3 x 2"):
        measure(GIVEN[:, :3], TRUTH)
    with pytest.raises(ShapeMismatch, match="counted"):
        measure(GIVEN, TRUTH, np.ones((1, 4), bool))
