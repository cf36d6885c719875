"""What `make_phantom` promises."""

import numpy as np
import pytest

from stereomend.errors import InvalidParameter
from stereomend.phantom import make_phantom
from stereomend.phantom.geometry import Frame, make_scene
from stereomend.phantom.scene import observe


@pytest.mark.parametrize("instrument", [False, True])
@pytest.mark.parametrize(("width", "height"), [(1, 1), (7, 1), (1, 7), (33, 17), (631, 479)])
def test_any_size_gives_a_whole_phantom(width, height, instrument):
    phantom = make_phantom(2, width, height, instrument=instrument)
    assert phantom.pair.left.shape == phantom.pair.right.shape == (height, width, 3)
    assert phantom.pair.left.dtype == phantom.pair.right.dtype == np.uint8
    for array, dtype in ((phantom.truth, np.float32), (phantom.occluded, bool), (phantom.instrument, bool)):
        assert array.shape == (height, width)
        assert array.dtype == dtype
    assert np.isfinite(phantom.truth).all()
    assert (phantom.truth > 0).all()
    assert phantom.instrument.any() <= instrument


@pytest.mark.parametrize("instrument", [False, True])
@pytest.mark.parametrize(("width", "height", "nearest"), [(96, 80, 4.0), (240, 180, 14.4), (230, 207, 120.0)])
def test_the_nearest_point_has_the_disparity_asked_for(width, height, nearest, instrument):
    for seed in range(2):
        phantom = make_phantom(seed, width, height, max_disparity=nearest, instrument=instrument)
        assert phantom.truth.max() == pytest.approx(nearest, rel=0.02)


def test_the_farthest_point_has_about_half_of_the_largest_disparity():
    for seed in range(8):
        scene = make_scene(np.random.default_rng(seed), Frame.of(160, 128, 10.0), seed % 2 == 1)
        truth, _, _ = observe(scene)
        assert truth.max() == pytest.approx(10, rel=0.02)
        assert 0.3 < truth.min() / 10 < 0.7


def test_the_default_is_six_percent_of_the_width_and_never_over_120():
    assert make_phantom(1, 200, 60).truth.max() == pytest.approx(12, rel=0.02)
    assert make_phantom(1, 2400, 9).truth.max() == pytest.approx(120, rel=0.02)


def test_the_same_arguments_give_the_same_bytes_and_another_seed_others():
    first, again, other = (make_phantom(seed, 90, 70, instrument=True) for seed in (5, 5, 6))
    for name in ("truth", "occluded", "instrument"):
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes()
    assert first.pair.left.tobytes() == again.pair.left.tobytes()
    assert first.pair.right.tobytes() == again.pair.right.tobytes()
    assert first.truth.tobytes() != other.truth.tobytes()
    assert first.pair.left.tobytes() != other.pair.left.tobytes()


def test_the_instrument_is_nearer_than_the_tissue_beside_it():
    for seed in range(6):
        truth, _, shown = observe(make_scene(np.random.default_rng(seed), Frame.of(200, 160, 12.0), True))
        assert 0.01 < shown.mean() < 0.4
        step = shown[:, 1:] != shown[:, :-1]
        inner = np.where(shown[:, 1:], truth[:, 1:], truth[:, :-1])[step]
        outer = np.where(shown[:, 1:], truth[:, :-1], truth[:, 1:])[step]
        assert (inner > 1.02 * outer).all()


def test_the_cameras_differ_in_brightness_and_noise():
    means = []
    for seed in range(5):
        pair = make_phantom(seed, 60, 45).pair
        means.append(pair.right.mean() / pair.left.mean())
    assert max(means) > 1.02
    assert min(means) < 0.98


@pytest.mark.parametrize(
    "bad",
    [
        {"seed": -1},
        {"width": 0},
        {"height": 5000},
        {"max_disparity": 0.0},
        {"max_disparity": float("nan")},
        {"max_disparity": 1e6},
    ],
)
def test_numbers_out_of_range_are_refused(bad):
    with pytest.raises(InvalidParameter):
        make_phantom(**{"seed": 1, "width": 20, "height": 20, **bad})
