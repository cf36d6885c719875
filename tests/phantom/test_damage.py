"""Each damage breaks what it says and leaves the rest alone."""

import numpy as np
import pytest

from stereomend.errors import InvalidParameter
from stereomend.phantom import DAMAGES, break_disparity, good_disparity, make_phantom

SEEDS = range(4)


@pytest.fixture(scope="module", params=[(1, 320, 256, 20.0), (2, 290, 270, 60.0)], ids=str)
def phantom(request):
    seed, width, height, nearest = request.param
    return make_phantom(seed, width, height, max_disparity=nearest, instrument=True)


def broken(phantom, seed, *kinds):
    values = break_disparity(phantom, seed, kinds).values
    assert values.dtype == np.float32
    assert values.shape == phantom.truth.shape
    assert np.isfinite(values).all()
    assert (values >= 0).all()
    return values


@pytest.mark.parametrize("seed", SEEDS)
def test_spikes_are_few_scattered_and_far_off(phantom, seed):
    values = broken(phantom, seed, "spikes")
    off = values != phantom.truth
    assert 0.005 < off.mean() < 0.05
    assert np.median(np.abs(values - phantom.truth)[off]) > 0.2 * phantom.truth.max()
    halves = [half.mean() for half in np.array_split(off, 4, axis=0)]
    assert min(halves) > 0.2 * max(halves)


@pytest.mark.parametrize("seed", SEEDS)
def test_streaks_are_horizontal_runs_of_nearly_one_value(phantom, seed):
    values = broken(phantom, seed, "streaks")
    error = np.abs(values - phantom.truth)
    off = error > 0.05 * phantom.truth.max()
    assert 0.003 < off.mean() < 0.25
    assert off[:, 1:][off[:, :-1]].mean() > 0.9
    assert (error[off] > 0.05 * phantom.truth.max()).all()
    assert (values == phantom.truth).mean() > 0.7
    run = off[:, 1:] & off[:, :-1]
    assert np.median(np.abs(np.diff(values, axis=1))[run]) < 0.01 * phantom.truth.max()


@pytest.mark.parametrize("seed", SEEDS)
def test_holes_lie_at_highlights_and_nowhere_else(phantom, seed):
    values = broken(phantom, seed, "holes")
    bright = phantom.pair.left.min(axis=-1) >= 225
    assert bright.any()
    assert (values[bright] == 0).all()
    assert 0 < (values == 0).mean() < 0.3
    known = values > 0
    assert np.array_equal(values[known], phantom.truth[known])
    rows, columns = np.nonzero(values == 0)
    glint_rows, glint_columns = np.nonzero(bright)
    for row, column in list(zip(rows, columns, strict=True))[::97]:
        assert np.hypot(glint_rows - row, glint_columns - column).min() < 0.03 * phantom.truth.shape[1]


@pytest.mark.parametrize("seed", SEEDS)
def test_the_left_border_is_wrong_as_far_as_matches_lie_outside(phantom, seed):
    values = broken(phantom, seed, "border")
    columns = np.arange(values.shape[1])[None, :]
    outside = columns < 0.5 * phantom.truth
    wrong = (values == 0) | (np.abs(values - phantom.truth) > 0.03 * phantom.truth.max())
    assert wrong[outside].mean() > 0.6
    beyond = columns > 1.8 * phantom.truth.max()
    assert np.array_equal(values[:, beyond[0]], phantom.truth[:, beyond[0]])


@pytest.mark.parametrize("seed", SEEDS)
def test_regions_are_large_smooth_and_off_by_much(phantom, seed):
    values = broken(phantom, seed, "regions")
    nearest = phantom.truth.max()
    off = np.abs(values - phantom.truth) > 0.08 * nearest
    assert 0.01 < off.mean() < 0.45
    inside = off[:, 1:] & off[:, :-1]
    assert np.median(np.abs(np.diff(values, axis=1))[inside]) < 0.02 * nearest
    assert (values == phantom.truth).mean() > 0.5


@pytest.mark.parametrize("seed", SEEDS)
def test_scale_is_one_factor_and_one_offset_for_the_whole_map(phantom, seed):
    values = broken(phantom, seed, "scale").astype(float)
    truth = phantom.truth.astype(float)
    factor, offset = np.polyfit(truth.ravel(), values.ravel(), 1)
    assert 0.49 < factor < 0.81 or 1.19 < factor < 2.01
    assert abs(offset) <= 0.051 * truth.max()
    assert np.abs(values - factor * truth - offset).max() < 1e-3 * truth.max()


@pytest.mark.parametrize("seed", SEEDS)
def test_mixed_is_roughly_right_with_many_faults(phantom, seed):
    values = broken(phantom, seed, "mixed")
    known = values > 0
    error = np.abs(values - phantom.truth)[known] / phantom.truth.max()
    assert 0.003 < np.median(error) < 0.06
    assert 0.02 < (error > 0.1).mean() < 0.5
    assert (error < 1e-6).mean() < 0.01
    assert (~known).any()


def test_a_map_scaled_after_holes_keeps_its_holes(phantom):
    holes = break_disparity(phantom, 3, ("holes",)).valid
    assert np.array_equal(break_disparity(phantom, 3, ("scale", "holes")).valid, holes)


@pytest.mark.parametrize("kind", [*DAMAGES, "mixed"])
def test_the_seed_decides_and_the_truth_stays(phantom, kind):
    before = phantom.truth.copy()
    first, again, other = (break_disparity(phantom, seed, (kind,)).values for seed in (8, 8, 9))
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()
    assert np.array_equal(phantom.truth, before)


def test_good_maps_are_right(phantom):
    truth = phantom.truth
    smooth = good_disparity(phantom, 1).values - truth
    assert np.sqrt(np.mean(smooth**2)) == pytest.approx(0.3, abs=0.02)
    assert np.abs(np.diff(smooth, axis=1)).max() < 0.3
    quantised = good_disparity(phantom, 1, "quantised").values
    assert np.array_equal(quantised, np.rint(quantised))
    assert np.abs(quantised - truth).max() <= 0.5
    assert np.array_equal(good_disparity(phantom, 1, "exact").values, truth)
    blurred = np.abs(good_disparity(phantom, 1, "blurred").values - truth)
    assert np.median(blurred) < 0.01
    assert blurred.max() > 0.05 * truth.max()


@pytest.mark.parametrize(("width", "height"), [(1, 1), (7, 1), (1, 7), (33, 17)])
def test_tiny_maps_are_broken_and_made_too(width, height):
    tiny = make_phantom(1, width, height)
    for kind in (*DAMAGES, "mixed"):
        broken(tiny, 1, kind)
    for kind in ("smooth", "blurred", "quantised", "exact"):
        assert good_disparity(tiny, 1, kind).valid.all()


def test_unknown_kinds_and_negative_seeds_are_refused(phantom):
    with pytest.raises(InvalidParameter, match="spikes"):
        break_disparity(phantom, 1, ("nonsense",))
    with pytest.raises(InvalidParameter, match="quantised"):
        good_disparity(phantom, 1, "nonsense")
    with pytest.raises(InvalidParameter):
        break_disparity(phantom, -1)
