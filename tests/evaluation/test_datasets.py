import numpy as np
import pytest

from stereomend.errors import DamagedFile, InvalidParameter, ShapeMismatch, UnknownFormat
from stereomend.evaluation.datasets import DATASETS, find_frames
from stereomend.evaluation.frame import Frame
from stereomend.phantom import make_phantom


@pytest.mark.parametrize("dataset", DATASETS)
def test_an_empty_or_missing_folder_is_named(tmp_path, dataset):
    with pytest.raises(UnknownFormat, match=f"{tmp_path}.* is (empty|missing)|does not exist"):
        find_frames(dataset, tmp_path, 10**6)
    with pytest.raises(UnknownFormat, match="nowhere"):
        find_frames(dataset, tmp_path / "nowhere", 10**6)


def test_unknown_datasets_are_refused_with_the_known_ones(tmp_path):
    with pytest.raises(InvalidParameter, match="dataset: got 'scarred', expected one of serv-ct, scared"):
        find_frames("scarred", tmp_path, 10**6)


def test_a_phantom_comes_back_as_it_was_made(phantoms):
    entries = find_frames("phantom", phantoms / "data", 10**6)
    assert [entry.name for entry in entries] == [f"phantom_{seed:04d}" for seed in range(7)]
    made, frame = make_phantom(5, 96, 64), entries[5].load().check()
    np.testing.assert_array_equal(frame.left, made.pair.left)
    np.testing.assert_array_equal(frame.right, made.pair.right)
    np.testing.assert_array_equal(frame.visible, ~made.occluded)
    np.testing.assert_allclose(frame.truth, made.truth, atol=1 / 512 + 1e-6)
    depth = made.focal_px * made.baseline_mm / frame.truth
    np.testing.assert_allclose(frame.calibration.depth_mm(frame.truth), depth, rtol=1e-6)
    assert (frame.calibration.cx, frame.calibration.cy) == (47.5, 31.5)


@pytest.mark.parametrize("text", ["", "[]", '{"focal_px": "far", "baseline_mm": 1}', '{"focal_px": 1}'])
def test_a_phantom_with_a_broken_calibration_is_named(phantoms, tree, text):
    for name in ("left.png", "right.png", "truth.png", "occluded.png"):
        tree.path(f"one/{name}").write_bytes((phantoms / "data/phantom_0000" / name).read_bytes())
    tree.text("one/calibration.json", text)
    with pytest.raises(DamagedFile, match=r"calibration\.json: expected JSON with focal_px"):
        find_frames("phantom", tree.root, 10**6)[0].load()


def test_a_frame_whose_arrays_do_not_fit_together_is_refused():
    image, truth = np.zeros((4, 6, 3), np.uint8), np.ones((4, 6), np.float32)
    with pytest.raises(ShapeMismatch, match="true disparity is 5 x 4"):
        Frame(image, image, truth[:, :5]).check()
    with pytest.raises(ShapeMismatch, match="occlusion mask is 6 x 3"):
        Frame(image, image, truth, truth[:3] > 0).check()
    with pytest.raises(ShapeMismatch, match="right is 6 x 2"):
        Frame(image, image[:2], truth).check()
