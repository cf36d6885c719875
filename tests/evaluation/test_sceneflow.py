import numpy as np
import pytest

from stereomend.errors import UnknownFormat
from stereomend.evaluation.datasets import find_frames

HEIGHT, WIDTH, NEAR, FAR = 12, 30, 7, 2


def scene():
    """A near box over a far plane: both disparity maps, and what the right camera sees of the left image."""
    left = np.full((HEIGHT, WIDTH), FAR)
    left[3:9, 12:20] = NEAR
    right = np.full((HEIGHT, WIDTH), FAR)
    right[3:9, 12 - NEAR : 20 - NEAR] = NEAR
    visible = np.zeros((HEIGHT, WIDTH), bool)
    for row in range(HEIGHT):
        for column in range(WIDTH):
            nearest = {}
            for other in range(WIDTH):
                match = other - left[row, other]
                nearest[match] = max(nearest.get(match, 0), left[row, other])
            match = column - left[row, column]
            visible[row, column] = match >= 0 and nearest[match] == left[row, column]
    return left, right, visible


def write(tree, noise, frames="frames_cleanpass", sign=1):
    left, right, visible = scene()
    for side, disparity in (("left", left), ("right", sign * right)):
        tree.png(f"{frames}/TRAIN/A/0000/{side}/0006.png", noise(HEIGHT, WIDTH, 3))
        tree.pfm(f"disparity/TRAIN/A/0000/{side}/0006.pfm", disparity)
    return left, visible


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("frames", ["frames_cleanpass", "frames_finalpass"])
def test_visible_is_what_the_right_camera_sees(tree, noise, frames, sign):
    left, visible = write(tree, noise, frames, sign)
    (entry,) = find_frames("sceneflow", tree.root, 10**6)
    assert entry.name == "TRAIN/A/0000/0006"
    frame = entry.load().check()
    np.testing.assert_array_equal(frame.truth, left)
    np.testing.assert_array_equal(frame.visible, visible)
    assert 0 < visible.sum() < visible.size - HEIGHT * FAR
    assert frame.calibration is None


def test_missing_files_are_named(tree, noise):
    write(tree, noise)
    (tree.root / "disparity/TRAIN/A/0000/right/0006.pfm").unlink()
    with pytest.raises(UnknownFormat, match=r"right/0006\.pfm is missing"):
        find_frames("sceneflow", tree.root, 10**6)


def test_images_as_webp_are_named_and_not_ignored(tree, noise):
    write(tree, noise)
    for side in ("left", "right"):
        folder = tree.root / f"frames_cleanpass/TRAIN/A/0000/{side}"
        (folder / "0006.png").unlink()
        (folder / "0006.webp").write_bytes(b"RIFF\x1a\0\0\0WEBPVP8L")
    (entry,) = find_frames("sceneflow", tree.root, 10**6)
    with pytest.raises(UnknownFormat, match="WebP"):
        entry.load()
