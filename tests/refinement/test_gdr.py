"""What the global stage makes of the local one's map, and of what coarser levels found."""

import numpy as np
import pytest

from stereomend.disparity import StereoPair
from stereomend.opencv import cv2
from stereomend.phantom import make_phantom
from stereomend.refinement import parse_params, select_backend
from stereomend.refinement.gdr import Prior, prior_of, refine_globally, with_edges
from stereomend.refinement.ldr import Local
from stereomend.refinement.scene import make_scene
from stereomend.refinement.stage_params import GdrParams, LdrParams

NATIVE = select_backend("native", threads=2)


@pytest.fixture(scope="module")
def phantom():
    return make_phantom(312, 200, 160)


@pytest.fixture(scope="module")
def scene(phantom):
    return make_scene(phantom.pair, phantom.pair.shape, LdrParams(), NATIVE)


def test_a_prior_is_trusted_by_its_confidence_and_occlusions_by_a_weight_of_their_own():
    u, confidence = np.full((2, 3), 5, np.float32), np.array([[0, 0.5, 1], [1, 0, 0.2]], np.float32)
    occluded = np.array([[0, 0, 0], [0, 1, 1]], bool)
    params = GdrParams(data_weight=2, prior_weight=0.2, fill_weight=0.45)
    prior = prior_of(Local(u, ~occluded, occluded), confidence, params)
    assert prior.trust == pytest.approx(np.array([[0, 0.2, 0.4], [0.4, 0.9, 0.9]]))
    assert prior.trust.dtype == np.float32
    assert (prior.u == u).all()


def test_without_weights_a_prior_only_starts():
    u = np.full((2, 3), 5, np.float32)
    assert prior_of(Local(u, u > 0), u / 5, GdrParams()).trust is None


def test_where_nobody_looked_for_occlusions_confidence_decides():
    u = np.full((1, 2), 5, np.float32)
    params = GdrParams(data_weight=1, prior_weight=0.4, fill_weight=0.9)
    trust = prior_of(Local(u, u > 0), np.array([[0.5, 1]], np.float32), params).trust
    assert trust == pytest.approx(np.array([[0.2, 0.4]]))


def test_a_trusted_prior_holds_where_it_is_trusted_on_every_level(phantom, scene):
    """Half of the picture is drawn to a map far from the truth, with a weight that nothing outweighs."""
    wrong = phantom.truth + np.float32(9)
    trust = np.zeros_like(wrong)
    trust[:, 100:] = 50
    params = GdrParams(levels=3, warps=5, iterations=10, prior_weight=0.1)
    found = refine_globally(scene, Prior(wrong, trust), params, NATIVE).u
    assert np.abs(found - wrong)[:, 104:].max() < 0.01
    assert np.median(np.abs(found - phantom.truth)[:, 40:90]) < 0.5


def test_coarser_levels_can_have_a_schedule_of_their_own(scene, phantom):
    """Equal numbers named twice are no change; others are; and one level alone is the finest."""
    start = phantom.truth + np.float32(0.8)
    same, named, more = (
        refine_globally(scene, Prior(start), GdrParams(levels=3, warps=2, iterations=4, **coarse), NATIVE).u
        for coarse in (
            {},
            {"coarse_warps": 2, "coarse_iterations": 4},
            {"coarse_warps": 6, "coarse_iterations": 4},
        )
    )
    assert (same == named).all()
    assert (same != more).any()
    alone = [
        refine_globally(
            scene, Prior(start), GdrParams(levels=1, warps=2, iterations=4, coarse_warps=warps), NATIVE
        ).u
        for warps in (0, 9)
    ]
    assert (alone[0] == alone[1]).all()


def test_a_jump_stays_where_the_colours_change():
    """Two flat surfaces, one of each colour, and a start that is smeared over both."""
    rng, column = np.random.default_rng(4), np.arange(96)
    depth = np.where(column < 48, 3, 9) * np.ones((64, 1))
    paint = np.where(column[:, None] < 48, (150, 60, 50), (60, 90, 150))
    left = np.clip(paint + rng.normal(0, 12, (64, 96, 1)), 0, 255).astype(np.uint8)
    right = left[:, np.clip(column + np.where(column < 39, 3, 9), 0, 95)]
    scene = make_scene(StereoPair(left, right), (64, 96), LdrParams(), NATIVE)
    smeared = cv2.blur(depth.astype(np.float32), (13, 1))
    robust = parse_params({"preset": "robust"}).gdr
    wrong = []
    for params in (robust, robust.model_copy(update={"edge_level": None})):
        found = refine_globally(with_edges(scene, params, NATIVE), Prior(smeared), params, NATIVE).u
        wrong.append(np.mean(np.abs(found - depth)[:, 40:56] > 1))
    assert wrong[0] < 0.7 * wrong[1]
