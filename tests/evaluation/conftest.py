"""Small datasets in their true layouts, written with OpenCV, tifffile and plain bytes."""

import json
from pathlib import Path

import numpy as np
import pytest

from stereomend.opencv import cv2
from stereomend.phantom import break_disparity, make_phantom


class Tree:
    """Writes files under a folder."""

    def __init__(self, root):
        self.root = root

    def path(self, name) -> Path:
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def png(self, name, picture):
        """Grey as it is, colour as RGB."""
        picture = np.asarray(picture)
        stored = picture if picture.ndim == 2 else np.ascontiguousarray(picture[..., ::-1])
        self.path(name).write_bytes(cv2.imencode(".png", stored)[1].tobytes())

    def sixteen_bit(self, name, disparity):
        self.png(name, np.rint(np.asarray(disparity) * 256).astype(np.uint16))

    def pfm(self, name, values):
        values = np.asarray(values)
        head = f"Pf\n{values.shape[1]} {values.shape[0]}\n-1.0\n".encode()
        self.path(name).write_bytes(head + values[::-1].astype("<f4").tobytes())

    def text(self, name, text):
        self.path(name).write_text(text)

    def json(self, name, values):
        self.text(name, json.dumps(values))


@pytest.fixture
def tree(tmp_path):
    return Tree(tmp_path / "data")


@pytest.fixture
def noise():
    rng = np.random.default_rng(3)
    return lambda *shape: rng.integers(0, 256, shape, dtype=np.uint8)


@pytest.fixture(scope="session")
def phantoms(tmp_path_factory):
    """Seven phantoms as `stereomend phantom` writes them, with broken maps of a network as predictions."""
    from stereomend.demo import write_phantom

    folder = tmp_path_factory.mktemp("evaluated")
    made = [make_phantom(seed, 96, 64) for seed in range(7)]
    broken = [break_disparity(phantom, seed).values for seed, phantom in enumerate(made)]
    maps = folder / "maps" / "net"
    maps.mkdir(parents=True)
    for seed, (phantom, disparity) in enumerate(zip(made, broken, strict=True)):
        write_phantom(folder / "data" / f"phantom_{seed:04d}", phantom, disparity)
        np.save(maps / f"phantom_{seed:04d}.npy", disparity)
    return folder
