import numpy as np
import pytest

from stereomend.errors import DamagedFile, UnknownFormat
from stereomend.evaluation.datasets import find_frames

# The cameras of the first pair of 2015: their baseline is 0.5327 m.
LEFT = "7.215377e+02 0 6.095593e+02 4.485728e+01 0 7.215377e+02 1.728540e+02 2.163791e-01 0 0 1 2.745884e-03"
RIGHT = (
    "7.215377e+02 0 6.095593e+02 -3.395242e+02 0 7.215377e+02 1.728540e+02 2.199936e+00 0 0 1 2.729905e-03"
)
TRUTH = np.array([[0, 20.25, 30, 40], [50, 0, 60, 70]], np.float32)
SEEN = np.where([[True, True, False, True], [False, True, True, True]], TRUTH, 0)

YEARS = {
    2015: ("image_2", "image_3", "disp_occ_0", "disp_noc_0", "calib_cam_to_cam", "P_rect_02", "P_rect_03"),
    2012: ("colored_0", "colored_1", "disp_occ", "disp_noc", "calib", "P2", "P3"),
}


def write(tree, noise, year):
    left, right, occluded, visible, calibration, first, second = YEARS[year]
    for name in ("000000_10", "000001_10"):
        tree.png(f"training/{left}/{name}.png", noise(2, 4, 3))
        tree.png(f"training/{right}/{name}.png", noise(2, 4, 3))
        tree.png(f"training/{left}/{name[:-2]}11.png", noise(2, 4, 3))  # the next of the sequence: no truth
        tree.sixteen_bit(f"training/{occluded}/{name}.png", TRUTH)
        tree.sixteen_bit(f"training/{visible}/{name}.png", SEEN)
        time = "calib_time: 09-Jan-2012 13:57:47"
        tree.text(f"training/{calibration}/{name[:6]}.txt", f"{time}\n{first}: {LEFT}\n{second}: {RIGHT}\n")


@pytest.mark.parametrize("year", [2012, 2015])
def test_truth_visibility_and_the_known_baseline(tree, noise, year):
    write(tree, noise, year)
    entries = find_frames("kitti", tree.root, 10**6)
    assert [entry.name for entry in entries] == ["000000_10", "000001_10"]
    frame = entries[0].load().check()
    np.testing.assert_array_equal(frame.truth, TRUTH)
    np.testing.assert_array_equal(frame.visible, SEEN > 0)
    assert frame.calibration.baseline_mm == pytest.approx(532.7, abs=0.1)
    # 721.5377 px * 532.72 mm / 20.25 px
    assert frame.calibration.depth_mm(frame.truth)[0, 1] == pytest.approx(18_982, abs=5)


def test_swapped_cameras_are_noticed(tree, noise):
    write(tree, noise, 2015)
    text = f"P_rect_02: {RIGHT}\nP_rect_03: {LEFT}\n"
    tree.text("training/calib_cam_to_cam/000000.txt", text)
    with pytest.raises(DamagedFile, match=r"the baseline is -532\.7\d* mm; .* are the cameras swapped"):
        find_frames("kitti", tree.root, 10**6)[0].load()


def test_each_missing_file_is_named(tree, noise):
    write(tree, noise, 2015)
    (tree.root / "training/disp_noc_0/000001_10.png").unlink()
    with pytest.raises(UnknownFormat, match=r"disp_noc_0/000001_10\.png is missing; .* holds 000000_10\.png"):
        find_frames("kitti", tree.root, 10**6)


def test_a_folder_of_something_else_is_refused(tree, noise):
    tree.png("training/image_9/0.png", noise(2, 4))
    with pytest.raises(
        UnknownFormat, match=r"holds image_9; expected image_2 \(2015\) or colored_0 \(2012\)"
    ):
        find_frames("kitti", tree.root, 10**6)


@pytest.mark.parametrize("text", ["", f"P_rect_02: {LEFT}\n", f"P_rect_02: 1 2\nP_rect_03: {RIGHT}\n"])
def test_a_broken_calibration_is_named(tree, noise, text):
    write(tree, noise, 2015)
    tree.text("training/calib_cam_to_cam/000000.txt", text)
    with pytest.raises(DamagedFile, match=r"000000\.txt"):
        find_frames("kitti", tree.root, 10**6)[0].load()
