"""What the device is given: phantoms as the local stage leaves them, and solves with parts of the model."""

from functools import cache

import numpy as np

from stereomend.disparity import DisparityMap
from stereomend.opencv import cv2
from stereomend.phantom import break_disparity, make_phantom
from stereomend.refinement import parse_params, select_backend
from stereomend.refinement.backends import Guide, Problem
from stereomend.refinement.gdr import prior_of, with_edges
from stereomend.refinement.pipeline import Begun, locally, start_from
from stereomend.refinement.scene import make_scene
from stereomend.refinement.stage_params import GdrParams

NATIVE, REFERENCE = select_backend("native", threads=2), select_backend("reference")
PRESETS = ["released", "paper", "robust"]
ONE_WARP_PX = 2e-4
PARTS = ["plain", "edge", "prior", "observed_only", "averaging", "weight", "absolute", "all"]


def upload_of(width, height, seed=7):
    """A pair and its broken disparity."""
    phantom = make_phantom(seed, width, height)
    return phantom.pair, break_disparity(phantom, seed).values


def problem_of(preset, width, height, **gdr):
    """What the local stage hands on at full size, and the parameters."""
    pair, broken = upload_of(width, height)
    params = parse_params({"preset": preset, "processing_scale": 1, "gdr": gdr})
    scene = make_scene(pair, pair.shape, params.ldr, NATIVE)
    upload = DisparityMap.from_array(broken)
    begun = Begun(scene, start_from("upload", upload, scene, pair, NATIVE))
    trusted = locally(begun, params, NATIVE)
    prior = prior_of(trusted.local, trusted.confidence, params.gdr)
    scene = with_edges(scene, params.gdr, NATIVE)
    return Problem(*scene[:2], scene.channels, *prior, scene.edge, scene.weight), params.gdr


def near(found, expected):
    """The bar for whole runs: within 0.01 px on 99.7 % of the pixels."""
    assert found.shape == expected.shape
    assert found.dtype == np.float32
    share = np.mean(np.abs(found - expected) <= 0.01)
    print(f"{share:.5f} within 0.01 px, median difference {np.median(np.abs(found - expected)):.1e} px")
    return share >= 0.997


@cache
def large_phantom():
    return make_phantom(311, 320, 256, instrument=True)


def bars():
    """Bars too thin for coarse levels to find, before a plane, and a prior that knows them."""
    rng = np.random.default_rng(5)
    height, width = 80, 112
    u = np.full((height, width), 4, np.float32)
    for begin in range(30, 100, 16):
        u[:, begin : begin + 4] = 15
    right = cv2.GaussianBlur(rng.uniform(0, 255, (height, width)).astype(np.float32), (0, 0), 0.8)
    place = np.clip(np.arange(width) - u, 0, width - 1).astype(np.intp)
    left = np.take_along_axis(right, place, axis=1)
    params = parse_params({"preset": "robust", "gdr": {"levels": 4, "warps": 2}}).gdr
    trust = np.full_like(u, 0.02)
    return with_edges_of(Problem(left, right, (left,), u, trust), params), params


def with_edges_of(problem, params):
    return problem._replace(edge=NATIVE.edge_weights(problem.channels, params))


def case_of(part, size, **given):
    """One solve with one part of the model, or with all: see `device_work.Case`."""
    phantom = large_phantom()
    rng = np.random.default_rng(1)
    top, left = ((whole - side) // 2 for whole, side in zip(phantom.truth.shape, size, strict=True))
    cut = np.s_[top : top + size[0], left : left + size[1]]
    images = (image.mean(axis=2)[cut] for image in (phantom.pair.left, phantom.pair.right))
    u = phantom.truth[cut] + rng.normal(0, 0.7, size)
    state = tuple(np.ascontiguousarray(plane, np.float32) for plane in (*images, u))
    has = {name: part in (name, "all") for name in PARTS}
    params = GdrParams(
        **{"data_weight": 0.9, "warps": 1, "iterations": 10} | given,
        observed_only=has["observed_only"],
        averaging_px=3.5 if has["averaging"] else 0.0,
        descriptor="absolute" if part == "absolute" else "signed",
    )
    edge, weight, trust = rng.uniform(0.03, 1, (3, *size)).astype(np.float32)
    prior = (state[2] + rng.normal(0, 1, size)).astype(np.float32)
    guide = Guide(edge if has["edge"] else None, *((prior, 0.15 * trust) if has["prior"] else (None, None)))
    return state, params, weight if has["weight"] else None, guide


def solved(backend, case):
    """What another backend makes of it."""
    state, params, weight, guide = case
    return backend.solve(*state, params, weight=weight, guide=guide)


def out_of_the_image(part):
    """A case whose disparities lie far outside of the picture."""
    state, params, weight, guide = case_of(part, (20, 75))
    state[2][::2] *= -9
    state[2][1::4] += 1e5
    return state, params, weight, guide
