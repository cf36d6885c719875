"""One stereo pair of a dataset with what is known about it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from stereomend.disparity import Calibration, FloatMap, Image, Mask, check_image, check_same_size


class Frame(NamedTuple):
    """A rectified pair with its true disparity; every array has the height and width of `left`."""

    left: Image
    """uint8 or uint16, (H, W) or (H, W, 3) RGB."""
    right: Image
    """As `left`."""
    truth: FloatMap
    """True disparity of the left image, (H, W) px; 0 where unknown."""
    visible: Mask | None = None
    """Which pixels of the left image the right camera sees too, (H, W); None where the dataset is silent."""
    calibration: Calibration | None = None
    """What turns disparity into depth; None where the dataset has no depth in mm."""

    def check(self) -> Frame:
        """Return the frame (raises UnknownFormat or ShapeMismatch where its arrays do not fit together)."""
        check_image("left", self.left)
        check_image("right", self.right)
        check_same_size("right", self.right.shape, "left", self.left.shape)
        check_same_size("true disparity", self.truth.shape, "left", self.left.shape)
        if self.visible is not None:
            check_same_size("occlusion mask", self.visible.shape, "left", self.left.shape)
        return self


class Entry(NamedTuple):
    """A frame that is on disk with all its files, not yet read."""

    name: str
    """Unique in the dataset; parts are separated by slashes, such as `Experiment_1/001`."""
    load: Callable[[], Frame]
    """Reads it; raises InputError where a file cannot be used."""
