"""Write one scene for the C++ checks: a quality case beside the repository, or else a phantom."""

import sys
from pathlib import Path

import numpy as np

from stereomend.opencv import cv2
from stereomend.phantom import break_disparity, make_phantom

CASE = Path(__file__).parents[3] / "shared" / "quality" / "surg_tmi1"


def planes():
    """Left and right as grey levels, and a network's disparity, at half size."""
    if CASE.is_dir():
        left, right = (
            cv2.imread(str(CASE / f"{side}.png"), cv2.IMREAD_GRAYSCALE) for side in ("left", "right")
        )
        raw = cv2.imread(str(CASE / "raw_mccnn.png"), cv2.IMREAD_UNCHANGED) / 256
    else:
        phantom = make_phantom(1, 432, 400)
        left, right = (image.mean(axis=2) for image in (phantom.pair.left, phantom.pair.right))
        raw = break_disparity(phantom, 1).values
    return [
        plane[::2, ::2].astype(np.float32) * factor for plane, factor in ((left, 1), (right, 1), (raw, 0.5))
    ]


def main():
    scene = planes()
    height, width = scene[0].shape
    header = np.array([width, height], np.int32).tobytes()
    Path(sys.argv[1]).write_bytes(header + b"".join(plane.astype(np.float32).tobytes() for plane in scene))


if __name__ == "__main__":
    main()
