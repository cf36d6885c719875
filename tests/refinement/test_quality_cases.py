"""Real and semi-synthetic pairs with ground truth, where they lie beside the repository."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from stereomend import refine
from stereomend.opencv import cv2

CASES = Path(__file__).parents[3] / "shared" / "quality"

pytestmark = pytest.mark.skipif(not (CASES / "reference.json").is_file(), reason=f"{CASES} is not there")


def load(scene, raw):
    folder = CASES / scene
    left, right = (cv2.imread(str(folder / f"{side}.png"))[..., ::-1] for side in ("left", "right"))
    truth, raw = (
        cv2.imread(str(folder / name), cv2.IMREAD_UNCHANGED) / 256 for name in ("gt.png", f"raw_{raw}.png")
    )
    return np.ascontiguousarray(left), np.ascontiguousarray(right), truth, raw


def rmse(disparity, truth):
    return math.sqrt(np.mean((disparity - truth)[truth > 0] ** 2))


def mean_ratio(group, **params):
    """Geometric mean of the error after over the error before."""
    logs = []
    for case in json.loads((CASES / "reference.json").read_text()):
        scene, raw = case.split("/")
        if raw == "good" or scene.startswith("surg") != (group == "surgical"):
            continue
        left, right, truth, upload = load(scene, raw)
        refined = refine(left, right, upload, **params).disparity.astype(np.float64)
        logs.append(math.log(rmse(refined, truth) / rmse(upload, truth)))
    return math.exp(np.mean(logs))


@pytest.mark.parametrize(
    ("preset", "stages", "surgical", "natural"),
    [
        ("released", ["ldr", "gdr"], 0.13, 0.87),
        ("paper", ["ldr", "gdr"], 0.115, 0.85),
        ("released", ["ldr"], 0.45, 0.96),
        ("paper", ["ldr"], 0.43, 0.96),
    ],
)
def test_the_error_falls_as_far_as_it_should(preset, stages, surgical, natural):
    assert mean_ratio("surgical", preset=preset, stages=stages) <= surgical
    assert mean_ratio("natural", preset=preset, stages=stages) <= natural


def test_absolute_descriptors_are_far_worse():
    signed = mean_ratio("surgical", preset="released")
    assert mean_ratio("surgical", preset="released", gdr={"descriptor": "absolute"}) > 2 * signed


def cases():
    """Every case there is."""
    reference = CASES / "reference.json"
    return list(json.loads(reference.read_text())) if reference.is_file() else []


def paper_cases():
    """All cases; on one scene 50 warps of 5 iterations never settle.

    There the reference itself, disturbed by 1e-8 px after each warp, misses the bars,
    and float32 rounds at 1e-6 px.
    """
    unsettled = pytest.mark.xfail(reason="the iteration is chaotic there, in float64 too", strict=False)
    return [pytest.param(case, marks=unsettled if case.startswith("motorcycle") else ()) for case in cases()]


def deviation(case, preset):
    """Between the backends, (H, W), px."""
    left, right, _, upload = load(*case.split("/"))
    maps = [
        refine(left, right, upload, preset=preset, backend=name).disparity for name in ("native", "reference")
    ]
    return np.abs(maps[0].astype(np.float64) - maps[1])


@pytest.mark.parametrize("case", cases())
def test_released_matches_the_reference(case):
    assert np.mean(deviation(case, "released") <= 0.01) >= 0.999


@pytest.mark.parametrize("case", paper_cases())
def test_paper_matches_the_reference(case):
    error = deviation(case, "paper")
    assert np.mean(error <= 0.01) >= 0.997
    assert np.mean(error <= 0.05) >= 0.999
