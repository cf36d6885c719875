"""What the reference does with a guide, against identities and dense searches."""

import itertools
import math

import numpy as np
import pytest

from stereomend.refinement.backends import reference as ref
from stereomend.refinement.backends.data import (
    Guide,
)
from stereomend.refinement.stage_params import GdrParams

BACKEND = ref.ReferenceBackend("test")


@pytest.fixture
def rng():
    return np.random.default_rng(8)


@pytest.mark.parametrize("edge", [0.03, 0.4, 1.0])
@pytest.mark.parametrize(("sigma", "epsilon"), [(0.5, 0.1), (0.3, 1.0), (1.0, 0.0)])
def test_the_weighed_dual_prox_minimises_what_it_should(edge, sigma, epsilon, rng):
    """The conjugate of w times the Huber norm is epsilon |q|^2 / (2 w) inside a disc of radius w."""
    radius, angle = np.meshgrid(np.linspace(0, edge, 401), np.linspace(0, 2 * math.pi, 1601))
    grid = np.stack([radius * np.cos(angle), radius * np.sin(angle)])
    for point in np.concatenate([rng.uniform(-3, 3, (3, 2)), rng.uniform(-0.5, 0.5, (3, 2)) * edge]):
        cost = np.sum((grid - point[:, None, None]) ** 2, axis=0) / 2
        cost += sigma * epsilon * radius**2 / (2 * edge)
        best = grid[(slice(None), *np.unravel_index(cost.argmin(), cost.shape))]
        found = ref.prox_dual(point[:, None, None], sigma, epsilon, np.array([[edge]]))[:, 0, 0]
        assert found == pytest.approx(best, abs=5e-3 * edge)


def test_the_conjugate_of_the_weighed_dual_penalty_is_the_weighed_huber_norm():
    """max over |q| <= w of <q, g> - epsilon |q|^2 / (2 w) is w times Eq. 12."""
    for edge, epsilon, slope in itertools.product((0.03, 0.5), (0.1, 0.5), (0.02, 0.1, 0.4, 3.0)):
        q = np.linspace(-edge, edge, 20001)
        huber = slope**2 / (2 * epsilon) if slope <= epsilon else slope - epsilon / 2
        assert np.max(q * slope - epsilon * q**2 / (2 * edge)) == pytest.approx(edge * huber, abs=1e-6)


def test_each_pixel_has_a_dual_disc_of_its_own(rng):
    edge = rng.uniform(0.03, 1, (5, 7))
    found = ref.prox_dual(rng.uniform(-9, 9, (2, 5, 7)), 0.5, 0.1, edge)
    assert (np.hypot(*found) <= edge * (1 + 1e-12)).all()
    assert (np.hypot(*found) > 0.9 * edge).mean() > 0.9


def test_the_data_prox_with_a_prior_minimises_what_it_should(rng):
    """Both where the minimum lies at the kink, on the prior, and where it does not."""
    v, on_prior = np.linspace(-12, 12, 480001), 0
    low, high = [-5, 0.01, 0, -3, -6, 0], [5, 1, 4, 3, 6, 4]
    for u, step, a, b, prior, weight in rng.uniform(low, high, (40, 6)):
        cost = (v - u) ** 2 / 2 + step * (a * v**2 / 2 + b * v) + weight * np.abs(v - prior)
        data, draw = ((np.array([[p]]), np.array([[q]])) for p, q in ((a, b), (prior, weight)))
        found = ref.prox_data(np.array([[u]]), step, data, draw)[0, 0]
        assert found == pytest.approx(v[cost.argmin()], abs=1e-4)
        on_prior += found == prior
    assert 3 < on_prior < 37


def gaussian(deviation):
    """Weights at -r to r, r being twice the deviation, rounded up."""
    places = np.arange(-math.ceil(2 * deviation), math.ceil(2 * deviation) + 1)
    weights = np.exp(-((places / deviation) ** 2) / 2)
    return weights / weights.sum()


@pytest.mark.parametrize("deviation", [0.5, 1.3, 3.5])
@pytest.mark.parametrize("shape", [(8, 8), (9, 31), (61, 47)])
def test_window_means_are_those_of_a_mirrored_gaussian(shape, deviation, rng):
    values, weights = rng.standard_normal(shape), gaussian(deviation)
    radius = weights.size // 2
    padded = np.pad(values, radius, mode="symmetric")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (weights.size, weights.size))
    expected = np.einsum("yxij,i,j->yx", windows, weights, weights)
    assert np.allclose(ref.window_mean(values, deviation), expected)


@pytest.mark.parametrize("shape", [(1, 1), (1, 33), (33, 1), (2, 3), (61, 47)])
@pytest.mark.parametrize("deviation", [0.0, 0.5, 4.0])
def test_the_window_mean_of_a_constant_is_the_constant(shape, deviation):
    assert np.allclose(ref.window_mean(np.full(shape, 3.7), deviation), 3.7)


def test_without_a_deviation_the_window_is_the_pixel(rng):
    values = rng.standard_normal((5, 9))
    assert (ref.window_mean(values, 0.0) == values).all()


@pytest.mark.parametrize("shape", [(8, 8), (33, 9), (61, 47)])
def test_the_window_mean_is_its_own_adjoint_and_keeps_sums(shape, rng):
    """Then the averaged data term is still the gradient of an energy."""
    a, b = rng.standard_normal((2, *shape))
    assert np.sum(ref.window_mean(a, 3.5) * b) == pytest.approx(np.sum(a * ref.window_mean(b, 3.5)))
    assert np.sum(ref.window_mean(a, 3.5)) == pytest.approx(np.sum(a))


def slanted_pair(slope_x, slope_y):
    """Stripes of texture, defined on the right image's columns, and of none, with a linear disparity."""
    y, x = np.mgrid[:61, :97].astype(float)
    truth = 3 + slope_x * x + slope_y * y

    def texture(column):
        stripes = y % 24 < 12
        return 120 + stripes * (40 * np.sin(0.33 * column + 0.5 * y) + 30 * np.cos(0.25 * column - 0.4 * y))

    return texture(x - truth), texture(x), truth


@pytest.mark.parametrize(("slope_x", "slope_y"), [(0.0, 0.15), (0.0, -0.04), (0.03, 0.08)])
def test_an_averaged_data_term_keeps_a_slanted_plane(slope_x, slope_y):
    """Averaged as a function of the step; as one of u, it would pull each value towards its neighbours'.

    Where texture ends, those are all on one side, 2 px away and more.
    """
    left, right, truth = slanted_pair(slope_x, slope_y)
    params = GdrParams(data_weight=1, huber_epsilon=1, warps=10, iterations=40, averaging_px=3.5)
    found = BACKEND.solve(left, right, truth, params)
    error = np.abs(found - truth)[10:-10, 12:-12]
    assert np.sqrt(np.mean(error**2)) < 0.4 * abs(slope_y)


def test_where_nothing_is_shown_only_the_smoothness_has_a_say():
    """All matches lie outside: the pair must not matter, with or without the weight."""
    rng = np.random.default_rng(2)
    left, right, other = rng.uniform(0, 255, (3, 9, 13))
    u = rng.uniform(20, 30, (9, 13))
    params = GdrParams(warps=3, iterations=5, observed_only=True, averaging_px=1.0)
    first, second = (BACKEND.solve(left, view, u, params) for view in (right, other))
    assert (first == second).all()
    assert np.std(first) < 0.9 * np.std(u)
    seen = params.model_copy(update={"observed_only": False})
    inside = u - 19
    assert (BACKEND.solve(left, right, inside, seen) != BACKEND.solve(left, other, inside, seen)).any()


def test_a_weak_edge_lets_the_map_jump_where_it_is():
    """Without a data term, a step survives in the columns of the least weight and is levelled without."""
    u = np.where(np.arange(40) < 20, 2.0, 8.0) * np.ones((12, 1))
    nothing, edge = np.zeros_like(u), np.ones_like(u)
    edge[:, 19] = 0.001
    params = GdrParams(warps=1, iterations=400)
    kept = BACKEND.solve(nothing, nothing, u, params, guide=Guide(edge))
    levelled = BACKEND.solve(nothing, nothing, u, params)
    assert np.diff(kept[6])[19] > 5
    assert np.abs(np.diff(levelled[6])).max() < 1


def test_a_prior_pulls_as_its_trust_says():
    """No pair, no neighbour: each step moves u by tau times trust, until it is there."""
    nothing, prior = np.zeros((1, 1)), np.full((1, 1), 5.0)
    params = GdrParams(warps=1, iterations=4)
    for trust, expected in ((0.5, 1.5), (3.0, 4.0), (10.0, 5.0)):
        found = BACKEND.solve(
            nothing, nothing, nothing + 1, params, guide=Guide(None, prior, nothing + trust)
        )
        assert found[0, 0] == pytest.approx(expected)
