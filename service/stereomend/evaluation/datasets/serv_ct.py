"""SERV-CT: 16 pairs of porcine cadavers with a CT reference.

P. J. Edwards, D. Psychogyios, S. Speidel, L. Maier-Hein, D. Stoyanov, "SERV-CT: a disparity dataset from
cone-beam CT for validation of endoscopic 3D reconstruction", Medical Image Analysis 76, 2022. Layout:
https://github.com/surgical-vision/servcttk; other copies name the reference `Reference_CT`.
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stereomend.disparity import Calibration, Image, Mask
from stereomend.errors import DamagedFile, UnknownFormat
from stereomend.evaluation.files import Reader, find, first, need
from stereomend.evaluation.frame import Entry, Frame
from stereomend.evaluation.projection import as_projection, calibration_of

_OUTSIDE_REFERENCE = (0, 0, 255)
_UNSEEN = ((255, 255, 0), (255, 0, 0), (0, 255, 0))
"""Colours (RGB) of pixels that are beyond the other image, hidden in the right, hidden in the left one."""


class _Files(NamedTuple):
    left: Path
    right: Path
    disparity: Path
    occlusion: Path
    calibration: Path


def entries(root: Path, read: Reader) -> list[Entry]:
    """List the pairs, such as `Experiment_1/001` (raises UnknownFormat where a file is missing)."""
    lefts = find(root, "Experiment_*/Left_rectified/*.png")
    return [Entry(_name(left), partial(_load, _files(left), read)) for left in lefts]


def _name(left: Path) -> str:
    return f"{left.parents[1].name}/{left.stem}"


def _files(left: Path) -> _Files:
    experiment = left.parents[1]
    reference = first(experiment / "Ground_truth_CT", experiment / "Reference_CT")
    return _Files(
        left,
        need(experiment / "Right_rectified" / left.name),
        need(reference / "Disparity" / left.name),
        need(reference / "OcclusionL" / left.name),
        need(experiment / "Rectified_calibration" / f"{left.stem}.json"),
    )


def _load(files: _Files, read: Reader) -> Frame:
    truth, colours = read.disparity(files.disparity), read.image(files.occlusion)
    if colours.ndim != 3 or colours.shape[:2] != truth.shape:
        raise UnknownFormat(f"{files.occlusion}: shape {colours.shape}; expected RGB of shape {truth.shape}")
    truth[_painted(colours, _OUTSIDE_REFERENCE)] = 0
    unseen = np.any([_painted(colours, colour) for colour in _UNSEEN], axis=0)
    pair = read.image(files.left), read.image(files.right)
    return Frame(*pair, truth, ~unseen, _calibration(files.calibration))


def _painted(colours: Image, colour: tuple[int, int, int]) -> Mask:
    same: Mask = (colours == colour).all(axis=-1)
    return same


def _calibration(path: Path) -> Calibration:
    """P1 and P2 as OpenCV writes matrices into JSON, or as plain lists; px and mm."""
    try:
        known = json.loads(path.read_text())
        given = [known[name] for name in ("P1", "P2")]
    except (ValueError, KeyError, TypeError) as error:
        raise DamagedFile(f"{path}: expected JSON with P1 and P2") from error
    data = [matrix.get("data") if isinstance(matrix, dict) else matrix for matrix in given]
    return calibration_of(as_projection(data[0], f"{path}: P1"), as_projection(data[1], f"{path}: P2"))
