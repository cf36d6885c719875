"""What `stereomend phantom -o ROOT` writes: one folder per phantom."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

from stereomend.disparity import Calibration
from stereomend.errors import DamagedFile
from stereomend.evaluation.files import Reader, find, need
from stereomend.evaluation.frame import Entry, Frame

_FILES = ("left.png", "right.png", "truth.png", "occluded.png", "calibration.json")


def entries(root: Path, read: Reader) -> list[Entry]:
    """List the phantoms in `root` (raises UnknownFormat where there is none or a file is missing)."""
    folders = [path.parent for path in find(root, "*/truth.png")]
    for folder in folders:
        for name in _FILES:
            need(folder / name)
    return [Entry(folder.name, partial(_load, folder, read)) for folder in folders]


def _load(folder: Path, read: Reader) -> Frame:
    left = read.image(folder / "left.png")
    return Frame(
        left,
        read.image(folder / "right.png"),
        read.disparity(folder / "truth.png"),
        ~read.mask(folder / "occluded.png"),
        _calibration(folder / "calibration.json", left.shape[0], left.shape[1]),
    )


def _calibration(path: Path, height: int, width: int) -> Calibration:
    try:
        known = json.loads(path.read_text())
        focal_px, baseline_mm = float(known["focal_px"]), float(known["baseline_mm"])
    except (ValueError, KeyError, TypeError) as error:
        raise DamagedFile(f"{path}: expected JSON with focal_px and baseline_mm") from error
    return Calibration(focal_px, baseline_mm, cx=(width - 1) / 2, cy=(height - 1) / 2)
