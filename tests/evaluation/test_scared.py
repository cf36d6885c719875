"""Unrectified views of two planes, with the disparity after rectification from geometry."""

import numpy as np
import pytest
import tifffile

from stereomend.errors import DamagedFile, TooManyPixels, UnknownFormat
from stereomend.evaluation.datasets import find_frames
from stereomend.opencv import cv2

WIDTH, HEIGHT = 160, 128
SIZE = WIDTH, HEIGHT
M1 = np.array([[150.0, 0, 82], [0, 149, 61], [0, 0, 1]])
M2 = np.array([[152.0, 0, 75], [0, 151, 66], [0, 0, 1]])
D1 = np.array([0.05, -0.08, 0.002, -0.001, 0.01])
D2 = np.array([0.04, -0.05, -0.001, 0.002, 0.0])
R = cv2.Rodrigues(np.array([0.012, -0.02, 0.015]))[0]
T = np.array([[-4.2], [0.12], [-0.15]])
# n . X = 1 with X in mm: a floor that tilts away, and a nearer plane that covers the left part.
FAR = np.array([0.002, 0.001, 1 / 70])
NEAR = np.array([-0.001, 0.0015, 1 / 45])


def rays(matrix, distortion):
    """Directions of all pixels, (H, W, 3), Z = 1."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
    pixels = np.stack([columns, rows], -1).reshape(-1, 1, 2)
    flat = cv2.undistortPoints(pixels, matrix, distortion).reshape(HEIGHT, WIDTH, 2)
    return np.dstack([flat, np.ones((HEIGHT, WIDTH))])


def hit(origin, directions, plane):
    return origin + directions * ((1 - origin @ plane) / (directions @ plane))[..., None]


def paint(points):
    """A smooth texture that belongs to places in space, in grey levels."""
    x, y = points[..., 0], points[..., 1]
    return 128 + 50 * np.sin(0.35 * x + 0.1 * y) + 50 * np.cos(0.3 * y - 0.12 * x)


def grey(levels):
    return np.rint(np.repeat(levels[..., None], 3, axis=2)).astype(np.uint8)


def write(tree, plane, spoil=None, folder="dataset_1/keyframe_2"):
    points = hit(np.zeros(3), rays(M1, D1), plane)
    eye = (-R.T @ T).ravel()
    seen = hit(eye, rays(M2, D2) @ R, plane)  # R.T takes a right direction into the left system
    tree.png(f"{folder}/Left_Image.png", grey(paint(points)))
    tree.png(f"{folder}/Right_Image.png", grey(paint(seen)))
    if spoil is not None:
        points[spoil] = np.nan
    tifffile.imwrite(tree.path(f"{folder}/left_depth_map.tiff"), points.astype(np.float32), photometric="rgb")
    storage = cv2.FileStorage(str(tree.path(f"{folder}/endoscope_calibration.yaml")), cv2.FILE_STORAGE_WRITE)
    for name, value in (("R", R), ("T", T), ("M1", M1), ("D1", D1[None]), ("M2", M2), ("D2", D2[None])):
        storage.write(name, value)
    storage.release()
    return points


def load(tree):
    (entry,) = find_frames("scared", tree.root, 10**6)
    assert entry.name == "dataset_1/keyframe_2"
    return entry.load().check()


def sample(picture, x, y):
    return cv2.remap(
        np.asarray(picture, np.float32), x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR
    )


def projected(projection, points):
    """Of points in the rectified camera's own system; the fourth column of P2 would shift them again."""
    homogeneous = points @ projection[:, :3].T
    return homogeneous[..., 0] / homogeneous[..., 2], homogeneous[..., 1] / homogeneous[..., 2]


@pytest.mark.parametrize("plane", [FAR, NEAR], ids=["far", "near"])
def test_disparity_is_the_distance_of_both_projections(tree, plane):
    points = write(tree, plane)
    frame = load(tree)
    r1, r2, p1, p2, *_ = cv2.stereoRectify(
        M1, D1, M2, D2, SIZE, R, T, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0
    )
    inner = points[20:-20:7, 20:-20:7]
    left_x, left_y = projected(p1, inner @ r1.T)
    right_x, right_y = projected(p2, (inner @ R.T + T.ravel()) @ r2.T)
    np.testing.assert_allclose(left_y, right_y, atol=1e-6)
    shown = (left_x > 1) & (left_x < WIDTH - 2) & (left_y > 1) & (left_y < HEIGHT - 2)
    assert shown.sum() > 100
    found = sample(frame.truth, left_x, left_y)
    np.testing.assert_allclose(found[shown], (left_x - right_x)[shown], atol=0.001)


@pytest.mark.parametrize("plane", [FAR, NEAR], ids=["far", "near"])
def test_the_rectified_views_agree_where_the_disparity_says(tree, plane):
    write(tree, plane)
    frame = load(tree)
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    match = columns - frame.truth
    inside = (frame.truth > 0) & (match > 2) & (match < WIDTH - 3)
    inside[:3] = inside[-3:] = False
    warped = sample(frame.right[..., 0], match, rows)
    assert inside.mean() > 0.6
    assert np.abs(warped - frame.left[..., 0])[inside].mean() < 1
    wrong = sample(frame.right[..., 0], match + 2, rows)
    assert np.abs(wrong - frame.left[..., 0])[inside].mean() > 5


def test_the_baseline_is_the_distance_of_the_cameras_and_depth_lies_on_the_plane(tree):
    write(tree, FAR)
    frame = load(tree)
    assert frame.calibration.baseline_mm == pytest.approx(np.linalg.norm(T))
    cloud = frame.calibration.points_mm(frame.calibration.depth_mm(frame.truth))[10:-10, 10:-10]
    known = cloud[frame.truth[10:-10, 10:-10] > 0].astype(np.float64)
    # Rectification turns the plane about the camera's centre: its distance from there stays.
    normal = np.linalg.lstsq(known, np.ones(len(known)), rcond=None)[0]
    assert np.abs(known @ normal - 1).max() < 1e-3
    assert np.linalg.norm(normal) == pytest.approx(np.linalg.norm(FAR), rel=1e-3)


def test_what_lies_on_unknown_points_is_unknown_and_the_rest_stays(tree):
    spoiled, near = np.zeros((2, HEIGHT, WIDTH), bool)
    spoiled[50:70, 60:100] = True
    near[47:73, 57:103] = True
    points = write(tree, FAR)
    whole = load(tree).truth
    write(tree, FAR, spoiled)
    part = load(tree).truth
    r1, _, p1, *_ = cv2.stereoRectify(M1, D1, M2, D2, SIZE, R, T, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0)
    x, y = (np.rint(one).astype(int) for one in projected(p1, points @ r1.T))
    shown = (x >= 0) & (x < WIDTH) & (y >= 0) & (y < HEIGHT)
    assert (shown & spoiled).sum() == spoiled.sum()
    assert (part[y[spoiled], x[spoiled]] == 0).all()
    far = shown & ~near
    np.testing.assert_array_equal(part[y[far], x[far]], whole[y[far], x[far]])
    assert (whole[y[far], x[far]] > 0).mean() > 0.95


def test_broken_files_are_named(tree):
    write(tree, FAR)
    folder = tree.root / "dataset_1/keyframe_2"
    with pytest.raises(TooManyPixels):
        find_frames("scared", tree.root, 1000)[0].load()
    (folder / "endoscope_calibration.yaml").write_text("%YAML:1.0\n---\nM1: 3\n")
    with pytest.raises(DamagedFile, match=r"endoscope_calibration\.yaml: expected OpenCV YAML with M1"):
        load(tree)
    tifffile.imwrite(folder / "left_depth_map.tiff", np.ones((HEIGHT, WIDTH), np.float32))
    with pytest.raises(UnknownFormat, match=r"left_depth_map\.tiff: shape \(128, 160\); expected X, Y and Z"):
        load(tree)
    (folder / "left_depth_map.tiff").write_bytes(b"II*\0\xff\xff\xff\xff")
    with pytest.raises(DamagedFile, match=r"left_depth_map\.tiff"):
        load(tree)
    (folder / "left_depth_map.tiff").unlink()
    with pytest.raises(UnknownFormat, match=r"left_depth_map\.tiff is missing; .* holds Left_Image\.png"):
        load(tree)
