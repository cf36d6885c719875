"""The disparity maps to judge: `DIR/<method>/<frame>.(png|npy|pfm|tiff)`.

The slashes of a frame's name are folders, or `_`: `DIR/raft/Experiment_1/001.png` or
`DIR/raft/Experiment_1_001.png`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from stereomend.errors import InvalidParameter, UnknownFormat
from stereomend.evaluation.files import find, holds

ENDINGS = (".png", ".npy", ".pfm", ".tiff", ".tif")
"""PNG has 16 bits and is divided by 256; the others are floats in px."""


class Method(NamedTuple):
    """A stereo method's maps, one per frame."""

    name: str
    files: dict[str, Path]
    """From the name of a frame to its map."""


def find_methods(folder: Path, frames: Sequence[str]) -> list[Method]:
    """Find the maps of every method; each must have all frames.

    Args:
        folder: one folder per method lies in it.
        frames: the names of the frames.

    Raises:
        UnknownFormat: there is no folder, or a method lacks a frame.
        InvalidParameter: with `_` for slashes two frames have one name.
    """
    _check_unique(frames)
    folders = [path for path in find(folder, "*") if path.is_dir()]
    if not folders:
        raise UnknownFormat(f"{folder} {holds(folder)}; expected one folder per method")
    return [Method(one.name, {frame: _file(one, frame) for frame in frames}) for one in folders]


def _check_unique(frames: Sequence[str]) -> None:
    ((name, times),) = Counter(frame.replace("/", "_") for frame in frames).most_common(1)
    if times > 1:
        raise InvalidParameter(f"{times} frames are named {name} when their slashes become _; rename one")


def _file(method: Path, frame: str) -> Path:
    for stem in (frame, frame.replace("/", "_")):
        for ending in ENDINGS:
            path = method / f"{stem}{ending}"
            if path.is_file():
                return path
    raise UnknownFormat(
        f"{method / frame} is missing; expected it with one of {', '.join(ENDINGS)}, slashes may be _; "
        f"{method} {holds(method)}"
    )
