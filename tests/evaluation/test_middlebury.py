import numpy as np
import pytest

from stereomend.disparity import Calibration
from stereomend.errors import DamagedFile, UnknownFormat
from stereomend.evaluation.datasets import find_frames

# Of the scene Adirondack.
CALIBRATION = """\
cam0=[4161.221 0 1445.577; 0 4161.221 984.686; 0 0 1]
cam1=[4161.221 0 1654.636; 0 4161.221 984.686; 0 0 1]
doffs=209.059
baseline=176.252
width=2880
height=1988
ndisp=280
"""
TRUTH = np.array([[np.inf, 3, 2.5], [1.25, np.inf, 0.5]], np.float32)


def write(tree, noise, scene, truth="disp0.pfm", calibration=CALIBRATION):
    tree.png(f"{scene}/im0.png", noise(2, 3, 3))
    tree.png(f"{scene}/im1.png", noise(2, 3, 3))
    tree.pfm(f"{scene}/{truth}", TRUTH)
    tree.text(f"{scene}/calib.txt", calibration)


@pytest.mark.parametrize("truth", ["disp0.pfm", "disp0GT.pfm"])
def test_infinite_is_unknown_and_the_calibration_is_as_printed(tree, noise, truth):
    write(tree, noise, "trainingQ/Adirondack", truth)
    (entry,) = find_frames("middlebury", tree.root, 10**6)
    assert entry.name == "trainingQ/Adirondack"
    frame = entry.load().check()
    np.testing.assert_array_equal(frame.truth, [[0, 3, 2.5], [1.25, 0, 0.5]])
    assert frame.visible is None
    assert frame.calibration == Calibration(4161.221, 176.252, 1445.577, 984.686, 209.059)
    assert frame.calibration.depth_mm(frame.truth)[0, 1] == pytest.approx(176.252 * 4161.221 / 212.059)


def test_a_root_that_is_a_scene_has_its_name(tree, noise):
    write(tree, noise, "Piano")
    assert [entry.name for entry in find_frames("middlebury", tree.root / "Piano", 10**6)] == ["Piano"]


def test_the_mask_tells_what_is_hidden(tree, noise):
    write(tree, noise, "Piano", "disp0GT.pfm")
    tree.png("Piano/mask0nocc.png", np.uint8([[0, 255, 128], [255, 0, 128]]))
    (entry,) = find_frames("middlebury", tree.root, 10**6)
    assert entry.load().visible.tolist() == [[False, True, False], [True, False, False]]


def test_without_a_mask_the_right_disparity_tells(tree, noise):
    write(tree, noise, "Piano")
    tree.pfm("Piano/disp0.pfm", [[1, 1, 2], [1, 1, 1]])
    tree.pfm("Piano/disp1.pfm", [[2, 9, 9], [1, 9, 9]])
    (entry,) = find_frames("middlebury", tree.root, 10**6)
    # Column 0 leaves the image; in the last column of row 1 the right camera sees something nearer.
    assert entry.load().visible.tolist() == [[False, True, True], [False, True, False]]


@pytest.mark.parametrize(
    ("names", "height", "factor"),
    [
        (("im2.ppm", "im6.ppm", "disp2.pgm"), 375, 4),
        (("im2.png", "im6.png", "disp2.png"), 750, 2),
        (("view1.png", "view5.png", "disp1.png"), 370, 3),
        (("view1.png", "view5.png", "disp1.png"), 555, 2),
        (("view1.png", "view5.png", "disp1.png"), 1110, 1),
    ],
)
def test_older_maps_are_divided_by_the_factor_of_their_size(tree, noise, names, height, factor):
    stored = noise(height, 4)
    stored[0, 0] = 0
    for name, picture in zip(names, (noise(height, 4, 3), noise(height, 4, 3), stored), strict=True):
        if name.endswith("png"):
            tree.png(f"Cones/{name}", picture)
        else:
            kind = b"P5" if picture.ndim == 2 else b"P6"
            tree.path(f"Cones/{name}").write_bytes(kind + b"\n4 %d\n255\n" % height + picture.tobytes())
    (entry,) = find_frames("middlebury", tree.root, 10**6)
    frame = entry.load().check()
    np.testing.assert_allclose(frame.truth, stored / factor)
    assert frame.calibration is None


def test_an_unknown_size_is_refused_since_the_factor_is_unknown(tree, noise):
    for name in ("im2.png", "im6.png", "disp2.png"):
        tree.png(f"Cones/{name}", noise(100, 4))
    (entry,) = find_frames("middlebury", tree.root, 10**6)
    with pytest.raises(UnknownFormat, match=r"disp2\.png: 100 px high; expected one of 1500 \(times 1\)"):
        entry.load()


def test_missing_files_are_named(tree, noise):
    write(tree, noise, "Piano")
    (tree.root / "Piano/disp0.pfm").unlink()
    with pytest.raises(UnknownFormat, match=r"disp0\.pfm or .*disp0GT\.pfm is missing; .* holds calib\.txt"):
        find_frames("middlebury", tree.root, 10**6)


@pytest.mark.parametrize("text", ["", "cam0=[1 2 3]\n", CALIBRATION.replace("baseline", "base")])
def test_a_broken_calibration_is_named(tree, noise, text):
    write(tree, noise, "Piano", calibration=text)
    with pytest.raises(DamagedFile, match=r"calib\.txt: expected cam0"):
        find_frames("middlebury", tree.root, 10**6)[0].load()
