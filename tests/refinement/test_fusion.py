"""The choice between the upload and GDR's map: good maps of full size, and what it is told of them."""

from functools import cache

import numpy as np
import pytest

from stereomend import refine
from stereomend.phantom import break_disparity, good_disparity, make_phantom
from stereomend.refinement import parse_params
from stereomend.refinement.backends import ChoiceRule, Rivals
from stereomend.refinement.fusion import grain_of, mostly, without_chance
from stereomend.refinement.pyramid import Sparse

ONCE_WORSE = {
    "the shade of a shaft, where every disparity matches": (9003023, "quantised"),
    "a map that leads over the right edge of a shaft": (9003023, "smooth"),
    "the rim of a lobe, seen at a grazing angle": (14004023, "quantised"),
    "a shaft that leaves the frame aslant": (13002023, "blurred"),
    "the foot of a shaft before a surface that rises": (77013023, "smooth"),
    "a strip that a shaft hides, where GDR matches by chance": (78023, "smooth"),
}


@cache
def phantom_of(seed):
    """Of full laparoscopic size, where the error was."""
    return make_phantom(seed, 1100, 1024, max_disparity=140, instrument=True)


def rmse(disparity, truth):
    return float(np.sqrt(np.mean((disparity.astype(float) - truth) ** 2)))


@pytest.mark.parametrize("reason", ONCE_WORSE)
def test_a_good_map_of_full_size_is_not_made_worse(reason):
    seed, kind = ONCE_WORSE[reason]
    phantom = phantom_of(seed)
    good = good_disparity(phantom, seed, kind).values
    refined = refine(phantom.pair.left, phantom.pair.right, good, preset="robust").disparity
    assert rmse(refined, phantom.truth) <= 1.25 * rmse(good, phantom.truth)


def test_a_false_patch_that_hides_itself_does_not_stay():
    """It is lower than all around, and the right image shows something else in its place."""
    phantom = make_phantom(52617005, 1100, 1024, max_disparity=100)
    broken = break_disparity(phantom, 52617005, ["regions", "spikes", "holes", "border"]).values
    refined = refine(phantom.pair.left, phantom.pair.right, broken, preset="robust").disparity
    assert rmse(refined, phantom.truth) < 0.8


@pytest.mark.parametrize(
    ("seed", "damages"), [(4242016, ["border"]), (4242027, ["spikes", "holes", "border"])]
)
def test_a_false_border_does_not_stay_where_parts_of_it_join_the_truth(seed, damages):
    """Nothing beyond the frame can be seen; a few rows of it were believed, and off by several pixels."""
    phantom = make_phantom(seed, 640, 512, max_disparity=40)
    broken = break_disparity(phantom, seed, damages).values
    refined = refine(phantom.pair.left, phantom.pair.right, broken, preset="robust").disparity
    assert rmse(refined, phantom.truth) < 0.2


@pytest.mark.parametrize(("believed", "stays"), [(24, False), (25, True), (60, True), (100, True)])
def test_beyond_the_frame_less_than_a_quarter_is_chance(believed, stays):
    """Ten rows of ten pixels, of 20, whose match lies left of the frame; those of one more row are seen."""
    u = np.full((12, 20), 10, np.float32)
    u[10:] = 0
    nothing, shown = np.zeros_like(u), np.zeros(u.shape, np.bool_)
    shown[:, 10:] = True
    share = np.ones_like(u)
    share[:10, :10] = (np.arange(100) < believed).reshape(10, 10)
    u[11, :10], shown[11, :10] = 10, True
    rivals = Rivals(u, u > 0, u, nothing, nothing, shown, shown)
    found = without_chance(share, rivals, 0.25)
    hidden = (np.arange(20) < u) & ~shown
    assert (found == np.where(hidden & (not stays), 0, share)).all()


def test_most_is_more_than_half_of_the_pixels_around():
    rng = np.random.default_rng(2)
    whole = rng.random((20, 90)) < 0.3
    part = whole & (rng.random(whole.shape) < np.linspace(0, 1, 90))
    found = mostly(part, whole)
    inside = [(y, x) for y in range(4, 16) for x in range(14, 76)]
    for y, x in inside:
        around = np.s_[y - 3 : y + 4, x - 13 : x + 14]
        assert found[y, x] == (2 * part[around].sum() > whole[around].sum())
    assert 0.2 < np.mean([found[at] for at in inside]) < 0.8
    assert not mostly(part & False, whole & False).any()


def test_a_map_is_in_whole_pixels_if_every_value_is():
    u = np.random.default_rng(1).integers(0, 9, (150, 7)).astype(np.float32)
    assert grain_of(Sparse(u, u > 0)) == 1
    u[149, 6] = 3.5
    assert grain_of(Sparse(u, u > 0)) == 0


def test_steps_of_whole_pixels_are_smooth_whatever_is_told():
    params = parse_params({"preset": "robust", "fusion": {"step_px": 0.5}}).fusion
    assert ChoiceRule.of(params, 0.7, 0).step == pytest.approx(0.35)
    assert 0.7 < ChoiceRule.of(params, 0.7, 0, grain_px=1).step < 0.72
    wider = params.model_copy(update={"step_px": 3})
    assert ChoiceRule.of(wider, 0.7, 0, grain_px=1).step == pytest.approx(2.1)
