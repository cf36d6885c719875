"""What the solver is told besides the pair, and the kernels beside it: native, reference, brute force."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereomend.phantom import make_phantom
from stereomend.refinement import select_backend
from stereomend.refinement.backends.data import (
    UNGUIDED,
    Guide,
    OcclusionRule,
)
from stereomend.refinement.stage_params import GdrParams

SIZES = [(1, 1), (33, 1), (1, 33), (2, 3), (61, 47), (67, 53), (9, 300)]
PARTS = ["edge", "prior", "observed_only", "averaging", "all"]
NATIVE, REFERENCE = select_backend("native", threads=2), select_backend("reference")
EVERY_BACKEND = pytest.mark.parametrize("backend", [NATIVE, REFERENCE], ids=lambda backend: backend.name)


@pytest.fixture(scope="module")
def phantom():
    return make_phantom(311, 320, 256, instrument=True)


def crop_of(phantom, size):
    """Both images in grey and an estimate that is off by up to a pixel or so, from the phantom's middle."""
    top, left = ((whole - side) // 2 for whole, side in zip(phantom.truth.shape, size, strict=True))
    part = np.s_[top : top + size[0], left : left + size[1]]
    u = phantom.truth[part] + np.random.default_rng(0).normal(0, 0.7, size)
    planes = (phantom.pair.left.mean(axis=2)[part], phantom.pair.right.mean(axis=2)[part], u)
    return [np.ascontiguousarray(plane, np.float32) for plane in planes]


def told(part, u, warps):
    """Parameters and guide with one part of what `robust` adds, or with all; and weights of the data."""
    rng = np.random.default_rng(1)
    edge = rng.uniform(0.03, 1, u.shape).astype(np.float32)
    prior = (u + rng.normal(0, 1, u.shape)).astype(np.float32)
    trust = (0.15 * rng.random(u.shape) * (rng.random(u.shape) < 0.7)).astype(np.float32)
    params = GdrParams(
        data_weight=0.9,
        warps=warps,
        iterations=10,
        observed_only=part in ("observed_only", "all"),
        averaging_px=3.5 if part in ("averaging", "all") else 0.0,
    )
    guide = Guide(
        edge if part in ("edge", "all") else None,
        *((prior, trust) if part in ("prior", "all") else (None, None)),
    )
    return params, guide, rng.random(u.shape).astype(np.float32)


@pytest.mark.parametrize("weighed", [False, True])
@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("size", SIZES)
def test_one_guided_warp_matches_the_reference(size, part, weighed, phantom):
    state = crop_of(phantom, size)
    params, guide, weight = told(part, state[2], warps=1)
    solved = [
        backend.solve(*state, params, weight=weight if weighed else None, guide=guide)
        for backend in (NATIVE, REFERENCE)
    ]
    assert np.abs(solved[0] - solved[1]).max() <= 2e-4


@pytest.mark.parametrize("part", PARTS)
def test_each_part_of_the_guide_has_a_say(part, phantom):
    """Or matching the reference would say nothing."""
    state = crop_of(phantom, (61, 47))
    params, guide, _ = told(part, state[2], warps=1)
    plain = params.model_copy(update={"observed_only": False, "averaging_px": 0.0})
    guided, unguided = (
        NATIVE.solve(*state, given, guide=chosen) for given, chosen in ((params, guide), (plain, UNGUIDED))
    )
    assert np.abs(guided - unguided).max() > 0.05


@pytest.mark.parametrize("part", PARTS)
def test_a_few_guided_warps_stay_near_the_reference(part, phantom):
    state = crop_of(phantom, (121, 97))
    params, guide, weight = told(part, state[2], warps=4)
    error = np.abs(
        np.subtract(*(b.solve(*state, params, weight=weight, guide=guide) for b in (NATIVE, REFERENCE)))
    )
    assert np.mean(error <= 0.01) >= 0.999
    assert error.max() <= 0.05


@pytest.mark.parametrize("averaging", [0.5, 1.3, 4.0])
@pytest.mark.parametrize("size", [(1, 1), (5, 47), (47, 5), (61, 47)])
def test_every_window_matches_the_reference(size, averaging, phantom):
    """Also windows that are wider than the picture."""
    state, params = crop_of(phantom, size), GdrParams(warps=1, averaging_px=averaging)
    error = NATIVE.solve(*state, params) - REFERENCE.solve(*state, params)
    assert np.abs(error).max() <= 2e-4


@pytest.mark.parametrize("averaging", [0.0, 2.0])
def test_guided_disparities_out_of_the_image_match_the_reference(averaging, phantom):
    left, right, u = crop_of(phantom, (20, 31))
    u[::2] *= -9
    u[1::4] += 1e5
    params, guide, _ = told("all", u, warps=1)
    params = params.model_copy(update={"averaging_px": averaging})
    solved = [backend.solve(left, right, u, params, guide=guide) for backend in (NATIVE, REFERENCE)]
    assert np.allclose(*solved, rtol=5e-6, atol=2e-4)


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("size", [(33, 1), (3, 2000), (67, 53), (479, 631)])
def test_guided_results_are_bitwise_equal_for_any_number_of_threads(size, part):
    """Sizes that one thread does alone, that all sweep together, and that they follow each other through."""
    rng = np.random.default_rng(3)
    left, right = rng.uniform(0, 255, (2, *size)).astype(np.float32)
    u = rng.uniform(0, 12, size).astype(np.float32)
    params, guide, weight = told(part, u, warps=2)
    solved = [
        select_backend("native", n).solve(left, right, u, params, weight=weight, guide=guide)
        for n in (1, 2, 5)
    ]
    assert solved[0].tobytes() == solved[1].tobytes() == solved[2].tobytes()


def test_the_caller_s_guide_stays_as_it_is(phantom):
    state = crop_of(phantom, (61, 47))
    params, guide, weight = told("all", state[2], warps=2)
    planes = [*state, weight, *guide]
    before = [plane.copy() for plane in planes]
    NATIVE.solve(*state, params, weight=weight, guide=guide)
    assert all((a == b).all() for a, b in zip(planes, before, strict=True))


def test_a_strong_prior_holds_and_a_weak_one_yields(phantom):
    """|u - prior| outweighs the slope of the rest of the energy, or it does not: an L1 term is exact."""
    left, right, u = crop_of(phantom, (61, 47))
    prior, params = np.full_like(u, 25.0), GdrParams(warps=4, iterations=50)
    held, free = (
        NATIVE.solve(left, right, u, params, guide=Guide(None, prior, np.full_like(u, trust)))
        for trust in (50.0, 0.0)
    )
    assert (held == prior).all()
    assert np.abs(free - prior).min() > 1
    assert np.allclose(free, NATIVE.solve(left, right, u, params), atol=1e-3)


@pytest.mark.parametrize("size", [(1, 1), (3, 2000), (67, 53), (479, 631)])
def test_what_can_be_filled_and_reached_is_bitwise_equal_for_any_number_of_threads(size):
    rng = np.random.default_rng(5)
    u = rng.uniform(0, 40, size).astype(np.float32)
    seeds, passing, soft = (rng.random(size) < share for share in (0.02, 0.8, 0.3))
    results = []
    for threads in (1, 2, 5):
        backend = select_backend("native", threads)
        planes = (
            *backend.fill_occlusions(u, passing, OcclusionRule(1, 1.3, 6)),
            backend.reach(seeds, passing, soft, u, 9.0),
        )
        results.append([plane.tobytes() for plane in planes])
    assert results[0] == results[1] == results[2]


def occlusions(u, known, rule):
    """Hole by hole: from each unknown pixel, look left and right for what is known."""
    filled, flags = u.copy(), np.zeros(u.shape, bool)
    for y, x in np.argwhere(~known):
        before = [i for i in range(x) if known[y, i]]
        after = [i for i in range(x, u.shape[1]) if known[y, i]]
        if not before or not after:
            continue
        rise, length = float(u[y, after[0]]) - float(u[y, before[-1]]), after[0] - before[-1] - 1
        if rise > rule.step and length <= rule.stretch * rise + rule.slack:
            filled[y, x], flags[y, x] = u[y, before[-1]], True
    return filled, flags


@st.composite
def maps(draw):
    """A map of eighths of a pixel, exact in both precisions, and flags for it."""
    height, width = draw(st.sampled_from([(1, 1), (1, 33), (33, 1), (1, 2), (3, 47), (11, 9)]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    u = rng.integers(8, 8 * draw(st.sampled_from([3, 12, 40])), (height, width)) / 8
    shares = draw(st.tuples(*[st.sampled_from([0.0, 0.05, 0.3, 0.7, 0.95, 1.0])] * 3))
    return u.astype(np.float32), [rng.random((height, width)) < share for share in shares]


@EVERY_BACKEND
@settings(max_examples=60, deadline=None)
@given(
    drawn=maps(),
    rule=st.builds(
        OcclusionRule,
        st.sampled_from([0.0, 1.0, 4.125]),
        st.sampled_from([0.0, 0.5, 2.0]),
        st.sampled_from([0.0, 1.0, 6.0]),
    ),
)
def test_occlusions_are_filled_as_by_brute_force(backend, drawn, rule):
    u, (known, _, _) = drawn
    filled, flags = backend.fill_occlusions(u, known, rule)
    expected, expected_flags = occlusions(u, known, rule)
    assert (filled == expected).all()
    assert (flags == expected_flags).all()


@EVERY_BACKEND
def test_an_occlusion_gets_the_value_on_its_left_and_no_longer_run_does(backend):
    u = np.array([[4, 9, 9, 12, 4, 9, 9, 9, 12, 9, 9, 4, 9]], np.float32)
    known = np.array([[1, 0, 0, 1, 1, 0, 0, 0, 1, 0, 0, 1, 0]], bool)
    filled, flags = backend.fill_occlusions(u, known, OcclusionRule(1, 0.25, 0))
    assert filled.tolist() == [[4, 4, 4, 12, 4, 9, 9, 9, 12, 9, 9, 4, 9]]
    assert np.flatnonzero(flags).tolist() == [1, 2]


def walked(seeds, passing, soft, u, step):
    """Pixel by pixel, in the documented order: along rows right and left, then along columns down and up."""
    height, width = u.shape
    reached = {(int(y), int(x)) for y, x in np.argwhere(seeds)}
    everywhere = [(y, x) for y in range(height) for x in range(width)]
    for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        # In the direction of the walk, so that each pixel comes after the one that leads to it.
        for y, x in everywhere if dy + dx > 0 else reversed(everywhere):
            source = y - dy, x - dx
            if source not in reached or not passing[y, x]:
                continue
            if soft[y, x] or soft[source] or abs(float(u[y, x]) - float(u[source])) <= step:
                reached.add((y, x))
    return reached


@EVERY_BACKEND
@settings(max_examples=60, deadline=None)
@given(drawn=maps(), step=st.sampled_from([0.0, 0.125, 1.0, 6.0]))
def test_what_can_be_reached_is_found_as_by_walking(backend, drawn, step):
    u, (seeds, passing, soft) = drawn
    found = backend.reach(seeds, passing, soft, u, step)
    assert found.dtype == bool
    assert {(int(y), int(x)) for y, x in np.argwhere(found)} == walked(seeds, passing, soft, u, step)


@EVERY_BACKEND
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("width", [63, 64, 65, 127, 128, 129, 150, 192, 193])
def test_long_rows_are_walked_from_end_to_end(backend, width, turned):
    """Flags are walked 64 at a time: from both ends, with something in the way at or beside such seams."""
    rng = np.random.default_rng(width)
    for blocked in (None, 0, 1, 62, 63, 64, 65, 126, 127, 128, 191, 192):
        size = (12, width)
        seeds, passing = rng.random(size) < 0.01, rng.random(size) > 0.01
        seeds[0, 0] = seeds[1, -1] = True
        seeds[:2, 1:-1] = False
        passing[:4] = True
        if blocked is not None and blocked < width:
            passing[:4, blocked] = False
        soft = rng.random(size) < 0.1
        u = (20 + rng.integers(0, 2, size) + 9 * (rng.random(size) < 0.005)).astype(np.float32)
        flags = [np.ascontiguousarray(flag.T if turned else flag) for flag in (seeds, passing, soft)]
        land = np.ascontiguousarray(u.T if turned else u)
        found = backend.reach(*flags, land, 1.0)
        assert {(int(y), int(x)) for y, x in np.argwhere(found)} == walked(*flags, land, 1.0), blocked


@EVERY_BACKEND
def test_seeds_stay_reached_and_steps_and_soft_pixels_decide(backend):
    u = np.array([[5, 5, 5, 9, 9, 9], [5, 5, 5, 5, 5, 5]], np.float32)
    seeds = np.zeros((2, 6), bool)
    seeds[0, 0] = True
    passing = np.array([[0, 1, 1, 1, 1, 0], [0, 0, 0, 1, 0, 0]], bool)
    soft = np.zeros((2, 6), bool)
    assert backend.reach(seeds, passing, soft, u, 1.0).tolist()[0] == [True] * 3 + [False] * 3
    soft[0, 2] = True
    found = backend.reach(seeds, passing, soft, u, 1.0)
    assert found.tolist()[0] == [True] * 5 + [False]
    assert not found[1].any()  # (1, 3) differs by 4 from the reached pixel above it
    soft[1, 3] = True
    assert np.argwhere(backend.reach(seeds, passing, soft, u, 1.0)[1]).tolist() == [[3]]
