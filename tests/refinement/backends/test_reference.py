"""The reference against identities and brute force: nothing here is compared with itself."""

import itertools
import math

import numpy as np
import pytest

from stereomend.refinement.backends import reference as ref
from stereomend.refinement.backends.data import (
    Usable,
)
from stereomend.refinement.backends.reference_evidence import smoothness
from stereomend.refinement.stage_params import GdrParams, LdrParams

SHAPES = [(1, 1), (1, 7), (7, 1), (2, 2), (5, 9)]


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.mark.parametrize("shape", SHAPES)
def test_divergence_is_minus_the_adjoint_of_the_gradient(shape, rng):
    u, p = rng.standard_normal(shape), rng.standard_normal((2, *shape))
    assert np.sum(ref.gradient(u) * p) == pytest.approx(-np.sum(u * ref.divergence(p)), abs=1e-12)


def test_the_steps_respect_the_norm_of_the_gradient(rng):
    """Power iteration: |grad|^2 stays below 8, so 8 tau sigma <= 1 makes the iteration converge."""
    u = rng.standard_normal((40, 40))
    for _ in range(200):
        u = -ref.divergence(ref.gradient(u))
        norm = np.linalg.norm(u)
        u /= norm
    assert 7.5 < norm < 8
    assert 8 * GdrParams().tau * GdrParams().sigma <= 1


@pytest.mark.parametrize(("sigma", "epsilon"), [(0.5, 0.1), (0.3, 1.0), (1.0, 0.0)])
def test_the_dual_prox_minimises_what_it_should(sigma, epsilon, rng):
    """The conjugate of the Huber norm is epsilon |q|^2 / 2 inside the unit disc, infinite outside."""
    radius, angle = np.meshgrid(np.linspace(0, 1, 801), np.linspace(0, 2 * math.pi, 1601))
    grid = np.stack([radius * np.cos(angle), radius * np.sin(angle)])
    for point in rng.uniform(-3, 3, (6, 2)):
        cost = np.sum((grid - point[:, None, None]) ** 2, axis=0) / 2 + sigma * epsilon * radius**2 / 2
        best = grid[(slice(None), *np.unravel_index(cost.argmin(), cost.shape))]
        found = ref.prox_dual(point[:, None, None], sigma, epsilon)[:, 0, 0]
        assert found == pytest.approx(best, abs=4e-3)


def test_the_conjugate_of_the_dual_penalty_is_the_huber_norm():
    """max over |q| <= 1 of <q, g> - epsilon |q|^2 / 2 is Eq. 12: square up to epsilon, then norm."""
    q = np.linspace(-1, 1, 20001)
    for epsilon, gradient in itertools.product((0.1, 0.5), (0.02, 0.1, 0.4, 3.0)):
        huber = gradient**2 / (2 * epsilon) if gradient <= epsilon else gradient - epsilon / 2
        assert np.max(q * gradient - epsilon * q**2 / 2) == pytest.approx(huber, abs=1e-6)


def test_the_data_prox_minimises_what_it_should(rng):
    v = np.linspace(-20, 20, 400001)
    for u, step, a, b in rng.uniform([-5, 0.01, 0, -3], [5, 1, 4, 3], (8, 4)):
        cost = (v - u) ** 2 / 2 + step * (a * v**2 / 2 + b * v)
        found = ref.prox_data(np.array([[u]]), step, (np.array([[a]]), np.array([[b]])))[0, 0]
        assert found == pytest.approx(v[cost.argmin()], abs=1e-4)


def test_a_and_b_are_the_gradient_of_the_linearised_data_term(rng):
    """d/du of sum_k (r_k + g_k u)^2 / 2 by central differences, with r and g written out from the method."""
    own, warped, u = rng.standard_normal((8, 4, 6)), rng.standard_normal((8, 4, 6)), rng.uniform(0, 9, (4, 6))
    gg, gr = ref.linearise(own, warped)
    a, b = gg, gr - gg * u

    def energy(v, y, x):
        left, right = max(x - 1, 0), min(x + 1, 5)
        g = -(warped[:, y, right] - warped[:, y, left]) / (right - left)
        return np.sum((warped[:, y, x] + g * (v - u[y, x]) - own[:, y, x]) ** 2) / 2

    for y, x in itertools.product(range(4), range(6)):
        slope = (energy(3.0 + 1e-4, y, x) - energy(3.0 - 1e-4, y, x)) / 2e-4
        assert a[y, x] * 3.0 + b[y, x] == pytest.approx(slope, abs=1e-6)


def test_the_warp_follows_the_sign_convention_and_repeats_borders(rng):
    right, u = rng.uniform(0, 255, (3, 12)), rng.uniform(-15, 15, (3, 12))
    expected = [np.interp(np.arange(12) - u[y], np.arange(12), right[y]) for y in range(3)]
    assert np.allclose(ref.warp(right, u), expected)


def test_descriptors_are_unit_differences_and_vanish_without_contrast():
    image = np.zeros((3, 3))
    image[1, 2] = 5
    at_centre = ref.describe(image, "signed")[:, 1, 1]
    assert at_centre.tolist() == [0, 0, 0, 0, 1, 0, 0, 0]
    assert not ref.describe(np.full((4, 4), 99.0), "signed").any()
    assert not ref.describe(np.eye(4) * 1e-4, "signed").any()


def test_descriptors_ignore_gain_and_bias(rng):
    image = rng.uniform(20, 200, (9, 11))
    assert np.allclose(ref.describe(image, "signed"), ref.describe(1.3 * image - 12, "signed"))


def test_absolute_descriptors_lose_the_sign(rng):
    image = rng.uniform(0, 255, (6, 6))
    assert np.allclose(ref.describe(image, "absolute"), np.abs(ref.describe(image, "signed")))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("window", [3, 21])
def test_smoothness_compares_with_the_mean_over_valid_pixels_inside(shape, window, rng):
    u, valid = rng.uniform(1, 30, shape), rng.random(shape) < 0.7
    found = smoothness(u, valid, LdrParams(window=window, smoothness_weight=2.0))
    for y, x in np.ndindex(shape):
        around = [
            u[j, i]
            for j, i in np.ndindex(shape)
            if max(abs(j - y), abs(i - x)) <= window // 2 and valid[j, i]
        ]
        mean = np.mean(around) if around else 0
        assert found[y, x] == pytest.approx(max(0, 1 - 2 * abs(u[y, x] - mean) / mean) if around else 0)


def test_confidence_is_zero_where_the_match_leaves_the_right_image():
    backend, image = ref.ReferenceBackend("test"), np.full((2, 9), 100.0)
    everywhere = np.ones((2, 9), bool)
    confidence = backend.confidence(
        image, image, np.full((2, 9), 3.5), Usable(everywhere, everywhere), LdrParams(window=3)
    )
    assert confidence.tolist() == [[0] * 4 + [1] * 5] * 2


def test_two_negative_factors_do_not_make_an_inlier():
    """Without the max in Eq. 1 and 2 the product of two negatives would be positive."""
    backend = ref.ReferenceBackend("test")
    left, right, u = np.full((1, 15), 10.0), np.full((1, 15), 250.0), np.full((1, 15), 1.0)
    u[0, 7] = 9.0
    everywhere = np.ones((1, 15), bool)
    confidence = backend.confidence(left, right, u, Usable(everywhere, everywhere), LdrParams(window=5))
    assert confidence[0, 7] == 0


def brute_force_median(u, known, y, x, steps):
    met = []
    for dy, dx in itertools.product((-1, 0, 1), repeat=2):
        for step in range(1, steps + 1):
            j, i = y + step * dy, x + step * dx
            if (dy, dx) == (0, 0) or not (0 <= j < u.shape[0] and 0 <= i < u.shape[1]):
                break
            if known[j, i]:
                met.append(u[j, i])
                break
    return np.median(met) if met else None


@pytest.mark.parametrize("steps", [1, 3, 40])
def test_holes_get_the_median_of_inliers_met_in_eight_directions(steps, rng):
    u, known = rng.uniform(1, 50, (13, 17)), rng.random((13, 17)) < 0.15
    found = ref.directional_medians(u, known, steps)
    for y, x in np.argwhere(~known):
        expected = brute_force_median(u, known, y, x, steps)
        assert np.isnan(found[y, x]) if expected is None else found[y, x] == pytest.approx(expected)


def test_filling_repeats_then_takes_the_nearest_inlier(rng):
    u, known = rng.uniform(1, 50, (9, 23)), np.zeros((9, 23), bool)
    known[4, 2], known[1, 20] = True, True
    filled = ref.ReferenceBackend("test").fill(u, known, steps=2, passes=1)
    assert filled[4, 4] == u[4, 2]
    assert filled[8, 11] == u[4, 2]
    assert filled[0, 15] == u[1, 20]
    assert (filled[known] == u[known]).all()


def test_nothing_known_leaves_the_map_as_it_is(rng):
    u = rng.uniform(1, 50, (4, 4))
    assert (ref.ReferenceBackend("test").fill(u, np.zeros((4, 4), bool), steps=3, passes=2) == u).all()


def test_one_level_recovers_a_sine_disparity():
    """The scene is defined on the right image's columns, so the left image is exact by evaluation."""
    y, x = np.mgrid[:60, :120].astype(float)
    truth = 1.0 + 0.6 * np.sin(2 * math.pi * x / 120) * np.cos(2 * math.pi * y / 60)

    def texture(column):
        return 120 + 40 * np.sin(0.55 * column + 0.9 * y) + 30 * np.cos(0.35 * column - 0.6 * y)

    found = ref.ReferenceBackend("test").solve(
        texture(x - truth),
        texture(x),
        np.zeros_like(truth),
        GdrParams(data_weight=5.0, warps=60, iterations=20),
    )
    error = np.abs(found - truth)[6:-6, 6:-6]
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert np.sqrt(np.mean(truth**2)) > 1
