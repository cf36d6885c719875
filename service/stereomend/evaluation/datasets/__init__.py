"""The datasets that can be evaluated, each in the layout in which it is distributed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from stereomend.errors import InvalidParameter
from stereomend.evaluation.datasets import kitti, middlebury, phantom, scared, sceneflow, serv_ct
from stereomend.evaluation.files import Reader
from stereomend.evaluation.frame import Entry

DATASETS: Mapping[str, Callable[[Path, Reader], list[Entry]]] = MappingProxyType(
    {
        "serv-ct": serv_ct.entries,
        "scared": scared.entries,
        "middlebury": middlebury.entries,
        "kitti": kitti.entries,
        "sceneflow": sceneflow.entries,
        "phantom": phantom.entries,
    }
)
"""From the name of a dataset to what lists its frames."""


def find_frames(dataset: str, root: Path, max_pixels: int) -> list[Entry]:
    """List the frames of a dataset; nothing is decoded yet.

    Args:
        dataset: a key of `DATASETS`.
        root: the folder it was unpacked into.
        max_pixels: width times height above which no file is decoded.

    Raises:
        InvalidParameter: there is no such dataset.
        UnknownFormat: the folder has another layout, or a file of a frame is missing.
    """
    if dataset not in DATASETS:
        raise InvalidParameter(f"dataset: got {dataset!r}, expected one of {', '.join(DATASETS)}")
    return DATASETS[dataset](root, Reader(max_pixels))
