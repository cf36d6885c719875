"""Middlebury stereo: indoor scenes with truth from structured light, in three layouts.

- 2014 and the evaluation set, version 3: `im0.png`, `im1.png`, `disp0.pfm` or `disp0GT.pfm`, `calib.txt`,
  and `mask0nocc.png` in the latter. D. Scharstein et al., GCPR 2014.
- 2005 and 2006, two views: `view1.png`, `view5.png`, `disp1.png`, `disp5.png`. H. Hirschmueller,
  D. Scharstein, CVPR 2007.
- 2003: `im2`, `im6`, `disp2`, `disp6`. D. Scharstein, R. Szeliski, CVPR 2003.

The older ones store disparity times a factor that depends on the size, and no calibration.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stereomend.disparity import Calibration, DisparityMap, FloatMap, Mask
from stereomend.errors import DamagedFile, UnknownFormat
from stereomend.evaluation.files import Reader, first, holds, need
from stereomend.evaluation.frame import Entry, Frame
from stereomend.evaluation.visibility import visible_in_right

_VISIBLE = 255  # of mask0nocc.png; 128 is hidden in the other view, 0 unknown
_NUMBER = r"([-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)"


class _Scaled(NamedTuple):
    """A layout whose maps are integers: names without ending, and the factor for each height in px."""

    left: str
    right: str
    truth: str
    other: str
    factors: Mapping[int, int]


_SCALED = (
    _Scaled("im2", "im6", "disp2", "disp6", {1500: 1, 750: 2, 375: 4}),
    _Scaled("view1", "view5", "disp1", "disp5", {1110: 1, 555: 2, 370: 3}),
)


def entries(root: Path, read: Reader) -> list[Entry]:
    """List the scenes in and below `root` by their folders (raises UnknownFormat where there is none)."""
    found = [_exact(path.parent, root, read) for path in root.glob("**/im0.png")]
    for layout in _SCALED:
        for path in root.glob(f"**/{layout.left}.p[np][gm]"):
            found.append(_scaled(path, layout, root, read))
    if not found:
        raise UnknownFormat(
            f"{root} {holds(root)}; expected scenes with im0.png (2014), view1.png (2005, 2006) "
            "or im2.png (2003)"
        )
    return sorted(found, key=lambda entry: entry.name)


def _name(scene: Path, root: Path) -> str:
    return scene.relative_to(root).as_posix() if scene != root else root.resolve().name


def _exact(scene: Path, root: Path, read: Reader) -> Entry:
    truth = first(scene / "disp0.pfm", scene / "disp0GT.pfm")
    for name in ("im1.png", "calib.txt"):
        need(scene / name)
    return Entry(_name(scene, root), partial(_load_exact, scene, truth, read))


def _load_exact(scene: Path, truth: Path, read: Reader) -> Frame:
    disparity = read.disparity(truth)
    visible = _visible(scene, disparity, read)
    pair = read.image(scene / "im0.png"), read.image(scene / "im1.png")
    return Frame(*pair, disparity, visible, _calibration(scene / "calib.txt"))


def _visible(scene: Path, disparity: FloatMap, read: Reader) -> Mask | None:
    mask, other = scene / "mask0nocc.png", scene / "disp1.pfm"
    if mask.exists():
        seen: Mask = read.image(mask) == _VISIBLE
        return seen
    return visible_in_right(disparity, read.disparity(other)) if other.exists() else None


def _calibration(path: Path) -> Calibration:
    """Lines such as `cam0=[f 0 cx; 0 f cy; 0 0 1]`, `doffs=` in px and `baseline=` in mm."""
    text = path.read_text(errors="replace")
    camera = re.search(rf"cam0=\[{_NUMBER} +\S+ +{_NUMBER}; *\S+ +\S+ +{_NUMBER};", text)
    doffs, baseline = (re.search(rf"^{key}={_NUMBER}", text, re.MULTILINE) for key in ("doffs", "baseline"))
    if not (camera and doffs and baseline):
        raise DamagedFile(f"{path}: expected cam0=[f 0 cx; 0 f cy; 0 0 1], doffs= and baseline=")
    focal, cx, cy = map(float, camera.groups())
    return Calibration(focal, float(baseline[1]), cx, cy, float(doffs[1]))


def _scaled(left: Path, layout: _Scaled, root: Path, read: Reader) -> Entry:
    scene = left.parent
    first(*_either(scene, layout.right))
    first(*_either(scene, layout.truth))
    return Entry(_name(scene, root), partial(_load_scaled, left, layout, read))


def _either(scene: Path, name: str) -> list[Path]:
    return [scene / f"{name}{ending}" for ending in (".png", ".ppm", ".pgm")]


def _load_scaled(left: Path, layout: _Scaled, read: Reader) -> Frame:
    scene = left.parent
    truth = _divided(first(*_either(scene, layout.truth)), layout.factors, read)
    others = [path for path in _either(scene, layout.other) if path.exists()]
    visible = visible_in_right(truth, _divided(others[0], layout.factors, read)) if others else None
    return Frame(read.image(left), read.image(first(*_either(scene, layout.right))), truth, visible)


def _divided(path: Path, factors: Mapping[int, int], read: Reader) -> FloatMap:
    stored = read.image(path)
    if stored.shape[0] not in factors:
        sizes = ", ".join(f"{height} (times {factor})" for height, factor in factors.items())
        raise UnknownFormat(f"{path}: {stored.shape[0]} px high; expected one of {sizes}")
    return DisparityMap.from_array(stored / np.float32(factors[stored.shape[0]])).values
