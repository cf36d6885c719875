"""Finding and reading the files of a dataset, with messages that say what was found instead."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from stereomend.codec import decode_disparity, decode_image, decode_mask
from stereomend.disparity import FloatMap, Image, Mask
from stereomend.errors import UnknownFormat

_SHOWN = 6  # names in a message


class Reader(NamedTuple):
    """Reads files with the project's own decoders (all raise the errors of those)."""

    max_pixels: int
    """Width times height above which nothing is decoded."""

    def image(self, path: Path) -> Image:
        """A left or right image, uint8 or uint16, (H, W) or (H, W, 3) RGB."""
        return decode_image(path.read_bytes(), str(path), self.max_pixels)

    def disparity(self, path: Path) -> FloatMap:
        """A disparity map, (H, W) px, 0 where unknown; 16-bit PNG is divided by 256."""
        return decode_disparity(path.read_bytes(), str(path), self.max_pixels).values

    def mask(self, path: Path) -> Mask:
        """A mask, (H, W), false where the file has 0."""
        return decode_mask(path.read_bytes(), str(path), self.max_pixels)


def find(root: Path, pattern: str) -> list[Path]:
    """All paths under `root` that match a glob pattern, sorted (raises UnknownFormat where none does)."""
    found = sorted(root.glob(pattern))
    if not found:
        raise UnknownFormat(f"{root} {holds(root)}; expected {pattern} in it")
    return found


def need(path: Path) -> Path:
    """Return a path that must exist (raises UnknownFormat, which says what lies there instead)."""
    return first(path)


def first(*paths: Path) -> Path:
    """Return the first of several paths that exists (raises UnknownFormat where none does)."""
    for path in paths:
        if path.exists():
            return path
    expected = " or ".join(str(path) for path in paths)
    raise UnknownFormat(f"{expected} is missing; {paths[0].parent} {holds(paths[0].parent)}")


def holds(folder: Path) -> str:
    """What is in a folder, in words."""
    if not folder.is_dir():
        return "is a file" if folder.exists() else "does not exist"
    names = sorted(path.name for path in folder.iterdir())
    if not names:
        return "is empty"
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"holds {', '.join(names[:_SHOWN])}{more}"
