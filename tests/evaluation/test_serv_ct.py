import numpy as np
import pytest

from stereomend.errors import DamagedFile, UnknownFormat
from stereomend.evaluation.datasets import find_frames

FOCAL, BASELINE, CX, CX_RIGHT = 950.0, 5.4, 6.0, 8.5
BLUE, YELLOW, RED, GREEN, BLACK = (0, 0, 255), (255, 255, 0), (255, 0, 0), (0, 255, 0), (0, 0, 0)


def matrix(rows, as_opencv):
    data = [float(value) for row in rows for value in row]
    opencv = {"type_id": "opencv-matrix", "rows": 3, "cols": 4, "dt": "d", "data": data}
    return opencv if as_opencv else rows


def calibration(as_opencv=True):
    left = [[FOCAL, 0, CX, 0], [0, FOCAL, 4.0, 0], [0, 0, 1, 0]]
    right = [[FOCAL, 0, CX_RIGHT, -FOCAL * BASELINE], [0, FOCAL, 4.0, 0], [0, 0, 1, 0]]
    return {"P1": matrix(left, as_opencv), "P2": matrix(right, as_opencv)}


def write(tree, noise, reference="Ground_truth_CT", as_opencv=True):
    depth = np.linspace(60, 110, 9 * 12).reshape(9, 12)
    disparity = FOCAL * BASELINE / depth + CX - CX_RIGHT  # (f X / Z + c) - (f (X - B) / Z + c_right)
    colours = np.full((9, 12, 3), BLACK, np.uint8)
    colours[0, :5] = BLUE, YELLOW, RED, GREEN, (200, 200, 200)
    for experiment, name in (("Experiment_1", "001"), ("Experiment_2", "009")):
        for side in ("Left", "Right"):
            tree.png(f"{experiment}/{side}_rectified/{name}.png", noise(9, 12, 3))
        tree.sixteen_bit(f"{experiment}/{reference}/Disparity/{name}.png", disparity)
        tree.sixteen_bit(f"{experiment}/{reference}/DepthL/{name}.png", depth)
        tree.png(f"{experiment}/{reference}/OcclusionL/{name}.png", colours)
        tree.json(f"{experiment}/Rectified_calibration/{name}.json", calibration(as_opencv))
    return depth, disparity


@pytest.mark.parametrize("reference", ["Ground_truth_CT", "Reference_CT"])
@pytest.mark.parametrize("as_opencv", [True, False])
def test_disparity_and_calibration_give_the_true_depth(tree, noise, reference, as_opencv):
    depth, disparity = write(tree, noise, reference, as_opencv)
    entries = find_frames("serv-ct", tree.root, 10**6)
    assert [entry.name for entry in entries] == ["Experiment_1/001", "Experiment_2/009"]
    frame = entries[1].load().check()
    known = frame.truth > 0
    np.testing.assert_allclose(frame.truth[known], disparity[known], atol=1 / 512)
    np.testing.assert_allclose(frame.calibration.depth_mm(frame.truth)[known], depth[known], rtol=1e-4)


def test_blue_has_no_truth_and_yellow_red_and_green_are_hidden(tree, noise):
    write(tree, noise)
    frame = find_frames("serv-ct", tree.root, 10**6)[0].load()
    assert (frame.truth[0, :5] > 0).tolist() == [False, True, True, True, True]
    assert frame.visible[0, :6].tolist() == [True, False, False, False, True, True]
    assert (frame.truth[1:] > 0).all()
    assert frame.visible[1:].all()


@pytest.mark.parametrize(
    ("lost", "message"),
    [
        ("Right_rectified/001.png", r"Right_rectified/001\.png is missing"),
        ("Ground_truth_CT/OcclusionL/001.png", r"OcclusionL/001\.png is missing; .* is empty"),
        ("Rectified_calibration/001.json", r"001\.json is missing"),
    ],
)
def test_a_missing_file_is_named(tree, noise, lost, message):
    write(tree, noise)
    (tree.root / "Experiment_1" / lost).unlink()
    with pytest.raises(UnknownFormat, match=message):
        find_frames("serv-ct", tree.root, 10**6)


def test_the_wrong_folder_is_named_with_what_it_holds(tree, noise):
    write(tree, noise)
    with pytest.raises(UnknownFormat, match="Experiment_1 holds Ground_truth_CT, Left_rectified"):
        find_frames("serv-ct", tree.root / "Experiment_1", 10**6)


@pytest.mark.parametrize("text", ["{", "{}", '{"P1": [1, 2], "P2": 3}', "[]"])
def test_a_broken_calibration_is_named(tree, noise, text):
    write(tree, noise)
    tree.text("Experiment_1/Rectified_calibration/001.json", text)
    with pytest.raises(DamagedFile, match=r"001\.json"):
        find_frames("serv-ct", tree.root, 10**6)[0].load()
