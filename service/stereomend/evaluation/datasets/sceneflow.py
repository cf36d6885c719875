"""SceneFlow (FlyingThings3D, Monkaa, Driving): rendered pairs with the exact disparity of both views.

N. Mayer et al., "A large dataset to train convolutional networks for disparity, optical flow, and scene flow
estimation", CVPR 2016. Below `frames_cleanpass` (or `frames_finalpass`) and `disparity` the paths are equal.
Lengths have no unit, so there is no depth in mm.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stereomend.codec.formats import read_header
from stereomend.codec.headers import check_size, named
from stereomend.disparity import DisparityMap, FloatMap
from stereomend.errors import UnknownFormat
from stereomend.evaluation.files import Reader, first, need
from stereomend.evaluation.frame import Entry, Frame
from stereomend.evaluation.visibility import visible_in_right

_PASSES = ("frames_cleanpass", "frames_finalpass")
_EXPECTED = "PFM with one channel"


class _Files(NamedTuple):
    left: Path
    right: Path
    left_disparity: Path
    right_disparity: Path


def entries(root: Path, read: Reader) -> list[Entry]:
    """List the pairs, such as `TRAIN/A/0000/0006` (raises UnknownFormat for other layouts)."""
    frames = first(*(root / name for name in _PASSES))
    disparity = need(root / "disparity")
    lefts = sorted(path for path in frames.glob("**/left/*") if path.suffix in (".png", ".webp"))
    if not lefts:
        raise UnknownFormat(f"{frames}: no image; expected .../left/NNNN.png in it")
    return [_entry(left.relative_to(frames), frames, disparity, read) for left in lefts]


def _entry(left: Path, frames: Path, disparity: Path, read: Reader) -> Entry:
    right = left.parents[1] / "right" / left.name
    files = _Files(
        frames / left,
        need(frames / right),
        need(disparity / left.with_suffix(".pfm")),
        need(disparity / right.with_suffix(".pfm")),
    )
    return Entry((left.parents[1] / left.stem).as_posix(), partial(_load, files, read))


def _load(files: _Files, read: Reader) -> Frame:
    truth, right = (_magnitude(path, read) for path in (files.left_disparity, files.right_disparity))
    return Frame(read.image(files.left), read.image(files.right), truth, visible_in_right(truth, right))


def _magnitude(path: Path, read: Reader) -> FloatMap:
    """Disparity, (H, W) px; its sign depends on the release, and says nothing."""
    with named(str(path)):
        header = read_header(path.read_bytes(), _EXPECTED)
        check_size(header, read.max_pixels)
        if header.format != "PFM" or header.channels != 1:
            raise UnknownFormat(f"{header}; expected {_EXPECTED}")
        return DisparityMap.from_array(np.abs(header.decode())).values
