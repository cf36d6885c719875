"""KITTI stereo 2012 and 2015: 194 and 200 pairs from a car with sparse truth from a laser scanner.

A. Geiger, P. Lenz, R. Urtasun, CVPR 2012; M. Menze, A. Geiger, CVPR 2015. Only `training` has truth.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple

from stereomend.disparity import Calibration
from stereomend.errors import DamagedFile, UnknownFormat
from stereomend.evaluation.files import Reader, find, holds, need
from stereomend.evaluation.frame import Entry, Frame
from stereomend.evaluation.projection import as_projection, calibration_of

_MM_PER_M = 1000.0


class _Layout(NamedTuple):
    """Folders of `training`, and the keys of the colour cameras' projection matrices."""

    left: str
    right: str
    occluded: str
    """Truth of all pixels."""
    visible: str
    """Truth of the pixels that both cameras see."""
    calibration: str
    keys: tuple[str, str]


_LAYOUTS = (
    _Layout("image_2", "image_3", "disp_occ_0", "disp_noc_0", "calib_cam_to_cam", ("P_rect_02", "P_rect_03")),
    _Layout("colored_0", "colored_1", "disp_occ", "disp_noc", "calib", ("P2", "P3")),
)


def entries(root: Path, read: Reader) -> list[Entry]:
    """List the training pairs with truth, such as `000000_10` (raises UnknownFormat for other layouts)."""
    training = root / "training"
    for layout in _LAYOUTS:
        if (training / layout.left).is_dir():
            return [_entry(path, layout, read) for path in find(training, f"{layout.occluded}/*.png")]
    raise UnknownFormat(f"{training} {holds(training)}; expected image_2 (2015) or colored_0 (2012)")


def _entry(occluded: Path, layout: _Layout, read: Reader) -> Entry:
    training, name = occluded.parents[1], occluded.name
    for folder in (layout.left, layout.right, layout.visible):
        need(training / folder / name)
    need(_calibration_file(training, layout, name))
    return Entry(occluded.stem, partial(_load, training, name, layout, read))


def _calibration_file(training: Path, layout: _Layout, name: str) -> Path:
    return training / layout.calibration / f"{name.partition('_')[0]}.txt"


def _load(training: Path, name: str, layout: _Layout, read: Reader) -> Frame:
    return Frame(
        read.image(training / layout.left / name),
        read.image(training / layout.right / name),
        read.disparity(training / layout.occluded / name),
        read.disparity(training / layout.visible / name) > 0,
        _calibration(_calibration_file(training, layout, name), layout.keys),
    )


def _calibration(path: Path, keys: tuple[str, str]) -> Calibration:
    """Lines `KEY: numbers`, px and m."""
    lines = (line.partition(":") for line in path.read_text(errors="replace").splitlines())
    known = {key.strip(): values.split() for key, _, values in lines}
    if not set(keys) <= set(known):
        raise DamagedFile(f"{path}: has {', '.join(known) or 'nothing'}; expected {' and '.join(keys)}")
    left, right = (as_projection(known[key], f"{path}: {key}") for key in keys)
    return calibration_of(left, right, _MM_PER_M)
