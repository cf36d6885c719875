"""Evidence, confidence, speckles and edges: native, reference, brute force."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereomend.phantom import make_phantom
from stereomend.refinement import parse_params, select_backend
from stereomend.refinement.backends import ReuseRule, SpeckleRule, Usable
from stereomend.refinement.backends.data import (
    SMALLEST,
)
from stereomend.refinement.stage_params import GdrParams

SIZES = [(1, 1), (33, 1), (1, 40), (2, 2), (2, 3), (5, 64), (61, 47), (64, 48), (7, 128)]
NATIVE, REFERENCE = select_backend("native", threads=2), select_backend("reference")
EVERY_BACKEND = pytest.mark.parametrize("backend", [NATIVE, REFERENCE], ids=lambda backend: backend.name)
ROBUST = parse_params({"preset": "robust"})


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


def noise(size, seed=5):
    """Two pictures, a map with steps of half a pixel and with what says nothing, and two sets of flags."""
    rng = np.random.default_rng(seed)
    left, right = rng.uniform(0, 255, (2, *size)).astype(np.float32)
    u = (np.round(rng.uniform(0, 6, size) / 2) / 2 + 9 * (rng.random(size) < 0.02)).astype(np.float32)
    return left, right, u, Usable(rng.random(size) < 0.9, rng.random(size) < 0.95)


def unit_differences(image, y, x):
    """The differences to the neighbours of one pixel, of length 1, or 0 where there is no contrast."""
    height, width = image.shape
    differences = np.array(
        [
            image[min(max(y + dy, 0), height - 1), min(max(x + dx, 0), width - 1)] - image[y, x]
            for dy in (-1, 0, 1)
            for dx in (-1, 0, 1)
            if (dy, dx) != (0, 0)
        ]
    )
    norm = np.linalg.norm(differences)
    return differences / norm if norm > 1e-3 else 0 * differences


@EVERY_BACKEND
@pytest.mark.parametrize("size", [(1, 1), (33, 1), (1, 33), (2, 3), (31, 37)])
def test_evidence_is_the_mean_product_of_unit_vectors(size, backend, phantom):
    left, right, u = crop_of(phantom, size)
    left[:: max(size[0] // 3, 1), : size[1] // 2] = 40
    right[:, size[1] * 3 // 4 :] = 200
    exact = [plane.astype(np.float64) for plane in (left, right, u)]
    columns = np.arange(size[1])
    warped = np.array([np.interp(columns - exact[2][y], columns, exact[1][y]) for y in range(size[0])])
    products = np.zeros(size)
    for y, x in np.ndindex(size):
        products[y, x] = unit_differences(exact[0], y, x) @ unit_differences(warped, y, x)
    around = np.pad(products, 2, mode="symmetric")
    (found,) = backend.evidence(left, right, [u])
    assert found.shape == size
    for y, x in np.ndindex(size):
        assert found[y, x] == pytest.approx(around[y : y + 5, x : x + 5].mean(), abs=1e-4), (y, x)


@EVERY_BACKEND
def test_evidence_of_an_image_for_itself_is_1_for_its_negative_minus_1(backend):
    image = np.random.default_rng(4).uniform(20, 200, (47, 61)).astype(np.float32)
    nowhere = [np.zeros_like(image)]
    assert np.allclose(backend.evidence(image, image, nowhere), 1, atol=1e-5)
    assert np.allclose(backend.evidence(image, 220 - image, nowhere), -1, atol=1e-5)
    assert not np.any(backend.evidence(image, np.full_like(image, 99), nowhere))


@pytest.mark.parametrize("size", SIZES)
def test_evidence_matches_the_reference_however_many_maps_are_asked_for(size):
    left, right, u, _ = noise(size)
    maps = [u, u + np.float32(0.3), 3 - u]
    found, expected = (backend.evidence(left, right, maps) for backend in (NATIVE, REFERENCE))
    assert np.allclose(found, expected, rtol=0, atol=1e-5)
    for alone, together in zip(maps, found, strict=True):
        assert (NATIVE.evidence(left, right, [alone])[0] == together).all()
    assert NATIVE.evidence(left, right, []) == []


@pytest.mark.parametrize("far", [-1e9, 1e5, np.float32(3e38)])
def test_evidence_far_outside_of_the_right_image_matches_the_reference(far):
    left, right, u, _ = noise((21, 33))
    u[::2] = far
    found, expected = (backend.evidence(left, right, [u]) for backend in (NATIVE, REFERENCE))
    assert np.allclose(found, expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("speckle_share", [0.0, 0.0007, 0.05])
@pytest.mark.parametrize("size", SIZES)
def test_confidence_matches_the_reference(size, speckle_share):
    params = ROBUST.ldr.model_copy(update={"speckle_share": speckle_share, "least_evidence": -0.5})
    scene = noise(size)
    found, expected = (backend.evidence_confidence(*scene, params) for backend in (NATIVE, REFERENCE))
    assert np.allclose(found, expected, rtol=0, atol=1e-5)


@EVERY_BACKEND
def test_confidence_falls_with_the_distance_from_the_median(backend):
    """Of an image and itself, moved by a disparity of its own: all else is certain."""
    image = np.random.default_rng(6).uniform(20, 200, (24, 40)).astype(np.float32)
    u = np.full_like(image, 3)
    u[12, 20] = 5
    right = np.roll(image, -3, axis=1)
    everywhere = np.ones(u.shape, bool)
    params = ROBUST.ldr.model_copy(
        update={"least_evidence": -2.0, "full_evidence": -1.0, "speckle_share": 0.0}
    )
    confidence = backend.evidence_confidence(image, right, u, Usable(everywhere, everywhere), params)
    assert confidence[12, 20] == pytest.approx(math.exp(-2))
    assert confidence[12, 25] == 1
    assert not confidence[:, :3].any()
    speckled = params.model_copy(update={"speckle_share": 1 / u.size})
    without = backend.evidence_confidence(image, right, u, Usable(everywhere, everywhere), speckled)
    assert np.argwhere(without != confidence).tolist() == [[12, 20]]


@EVERY_BACKEND
def test_nothing_is_trusted_where_nothing_is_usable(backend):
    left, right, u, usable = noise((21, 33))
    for flags in (
        Usable(~usable.valid & usable.valid, usable.matte),
        Usable(usable.valid, usable.valid & False),
    ):
        assert not backend.evidence_confidence(left, right, u, flags, ROBUST.ldr).any()
    small = np.full_like(u, SMALLEST)
    assert not backend.evidence_confidence(left, right, small, usable, ROBUST.ldr).any()


def labelled(u, valid, step):
    """Size of each pixel's patch by filling, (H, W), doubled for each side it touches; 0 for not valid."""
    sizes, last = np.zeros(u.shape, int), np.subtract(u.shape, 1)
    left = {(int(y), int(x)) for y, x in np.argwhere(valid)}
    while left:
        ends = [left.pop()]
        patch = list(ends)
        while ends:
            y, x = ends.pop()
            around = {(y + 1, x), (y - 1, x), (y, x + 1), (y, x - 1)} & left
            found = [there for there in around if abs(float(u[there]) - float(u[y, x])) <= step]
            left.difference_update(found)
            ends += found
            patch += found
        places = np.array(patch)
        sides = np.count_nonzero((places == 0).any(0)) + np.count_nonzero((places == last).any(0))
        sizes[tuple(places.T)] = len(patch) * 2**sides
    return sizes


@EVERY_BACKEND
@settings(max_examples=60, deadline=None)
@given(
    size=st.sampled_from([(1, 1), (33, 1), (1, 40), (2, 2), (17, 63), (9, 64), (9, 65), (5, 129), (40, 80)]),
    kinds=st.integers(1, 6),
    share=st.sampled_from([0.0, 0.4, 0.6, 0.9, 1.0]),
    largest=st.sampled_from([0, 1, 2, 7, 60, 10**6]),
    step=st.sampled_from([0.0, 0.125, 0.5, 1.0]),
    seed=st.integers(0, 2**32 - 1),
)
def test_speckles_are_the_small_patches_of_a_filling(backend, size, kinds, share, largest, step, seed):
    rng = np.random.default_rng(seed)
    u = (rng.integers(0, kinds, size) * 0.5).astype(np.float32)
    valid = rng.random(size) < share
    sizes = labelled(u, valid, step)
    found = backend.speckles(u, valid, SpeckleRule(largest, step))
    assert found.dtype == bool
    assert (found == (valid & (sizes <= largest))).all()


@EVERY_BACKEND
@pytest.mark.parametrize("turned", [False, True])
def test_one_long_winding_patch_is_one(backend, turned):
    """A path that goes back and forth through all bands of rows."""
    u = np.zeros((61, 131), np.float32)
    u[1::2] = 5
    u[1::4, -1] = u[3::4, 0] = 0
    u = np.ascontiguousarray(u.T if turned else u)
    valid = np.ones(u.shape, bool)
    path = u == 0
    size = 16 * int(path.sum())  # it touches all four sides
    assert not (backend.speckles(u, valid, SpeckleRule(size - 1)) & path).any()
    assert (backend.speckles(u, valid, SpeckleRule(size)) & path)[path].all()


@EVERY_BACKEND
def test_a_step_counts_as_it_is_and_not_rounded(backend):
    step = np.float32(1 + 2**-10)
    u = np.array([[1, 2, 3, 3 + step, 4 + step]], np.float32)
    valid = np.ones(u.shape, bool)
    assert backend.speckles(u, valid, SpeckleRule(8 * 2)).tolist() == [[False] * 3 + [True] * 2]


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("size", SIZES)
def test_edge_weights_match_the_reference(size, count):
    rng = np.random.default_rng(8)
    channels = list(rng.uniform(0, 255, (count, *size)).astype(np.float32))
    for level, power in ((14, 0.8), (180, 2.0), (700, 0.1), (80, 4)):
        for contrast in (1, 0.05, 1e-4):
            planes = [channel * np.float32(contrast) for channel in channels]
            params = GdrParams(edge_level=level, edge_power=power, edge_floor=0.001)
            found, expected = (backend.edge_weights(planes, params) for backend in (NATIVE, REFERENCE))
            assert np.allclose(found, expected, rtol=1e-5, atol=0)


@EVERY_BACKEND
def test_another_map_replaces_where_the_pair_says_far_more_for_it(backend):
    """The picture itself, moved by 3 px: in the lower half the map is right and the other one wrong."""
    image = np.random.default_rng(9).uniform(20, 200, (24, 40)).astype(np.float32)
    right, rows = np.roll(image, -3, axis=1), np.arange(24)[:, None]
    u, other = (np.where(rows < 12, *ends) + np.zeros_like(image) for ends in ((6, 3), (3, 6)))
    found = backend.better(image, right, u, other, ReuseRule(0.25))
    assert (found[:10, 8:] == 3).all()
    assert (found[14:, 8:] == 3).all()
    assert (found[:12, :3] == 6).all()  # the right image would not show it there
    assert (backend.better(image, right, u, other, ReuseRule(0.25, apart=3)) == u).all()
    assert (backend.better(image, right, u, other, ReuseRule(2)) == u).all()
    assert (backend.better(image, right, u, other, ReuseRule(-2, least=1)) == u).all()


@pytest.mark.parametrize("size", SIZES)
def test_the_better_of_two_maps_is_that_of_the_reference(size, phantom):
    left, right, u = crop_of(phantom, size)
    other = np.roll(u, 1, axis=0)
    rule = ReuseRule(0.1)
    found, expected = (backend.better(left, right, u, other, rule) for backend in (NATIVE, REFERENCE))
    of_u, of_other = REFERENCE.evidence(left, right, [u, other])
    sure = (np.abs(of_other - of_u - rule.margin) > 1e-4) & (np.abs(of_other - rule.least) > 1e-4)
    assert (found == expected)[sure].all()
    assert sure.mean() > 0.98 or u.size < 100


@pytest.mark.parametrize("size", [*SIZES, (8, 9), (9, 8), (131, 130)])
def test_halves_are_area_means(size):
    rng = np.random.default_rng(10)
    planes = list(rng.uniform(0, 255, (3, *size)).astype(np.float32))
    half = ((size[0] + 1) // 2, (size[1] + 1) // 2)
    for backend, tolerance in ((NATIVE, 1e-4), (REFERENCE, 1e-9)):
        for plane, found in zip(planes, backend.halve(planes), strict=True):
            assert found.shape == half
            assert np.allclose(found, REFERENCE.shrink(plane, half), rtol=0, atol=tolerance)
    assert NATIVE.halve([]) == REFERENCE.halve([]) == []


@EVERY_BACKEND
@pytest.mark.parametrize("size", SIZES)
def test_disparities_are_halved_as_their_weights_say(size, backend):
    rng = np.random.default_rng(11)
    u, weight = rng.uniform(0, 40, size).astype(np.float32), (rng.random(size) < 0.5).astype(np.float32)
    half = ((size[0] + 1) // 2, (size[1] + 1) // 2)
    found, share = backend.halve_weighed(u, weight)
    total, count = REFERENCE.shrink(u * weight, half), REFERENCE.shrink(weight, half)
    plain, some = REFERENCE.shrink(u, half), count > 0.01
    ratio = half[1] / size[1]
    assert np.allclose(share, count, atol=1e-6)
    assert np.allclose(found[some], (total / np.maximum(count, 1e-9) * ratio)[some], rtol=2e-3)
    assert np.allclose(found[count == 0], plain[count == 0] * ratio, rtol=1e-5)


@pytest.mark.parametrize("size", [(1, 1), (33, 1), (1, 40), (2, 2), (3, 2000), (61, 47), (479, 631)])
def test_what_the_pair_says_is_bitwise_equal_for_any_number_of_threads(size):
    left, right, u, usable = noise(size)
    results = []
    for threads in (1, 2, 5):
        backend = select_backend("native", threads)
        planes = (
            *backend.evidence(left, right, [u, u + 1, u]),
            backend.evidence_confidence(left, right, u, usable, ROBUST.ldr),
            backend.speckles(u, usable.valid, SpeckleRule(4)),
            backend.edge_weights([left, right, u], ROBUST.gdr),
            backend.better(left, right, u, u + 1, ReuseRule(0.0)),
            *backend.halve([left, right]),
            *backend.halve_weighed(u, left),
        )
        results.append([plane.tobytes() for plane in planes])
    assert results[0] == results[1] == results[2]


def test_planes_that_do_not_fit_are_refused():
    left, right, u, usable = noise((4, 6))
    engine_errors = (
        lambda: NATIVE.evidence(left, right, [u, u[:3]]),
        lambda: NATIVE.evidence_confidence(
            left, right, u, usable._replace(matte=usable.matte[:2]), ROBUST.ldr
        ),
        lambda: NATIVE.speckles(u, usable.valid[:, :5].copy(), SpeckleRule(4)),
        lambda: NATIVE.edge_weights([left, right[:2]], ROBUST.gdr),
        lambda: NATIVE.better(left, right, u, u[:2], ReuseRule(0)),
        lambda: NATIVE.halve([left, right[:2]]),
        lambda: NATIVE.halve_weighed(u, left[:2]),
        lambda: NATIVE.edge_weights([], ROBUST.gdr),
        lambda: NATIVE.edge_weights([left] * 4, ROBUST.gdr),
    )
    for call in engine_errors:
        with pytest.raises(ValueError, match=r"planes differ in shape|expected 1 to 3"):
            call()
