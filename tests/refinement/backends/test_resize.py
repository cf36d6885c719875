"""Changes of size: native, reference, brute force, OpenCV."""

from typing import NamedTuple

import numpy as np
import pytest

from stereomend import _native
from stereomend.opencv import cv2
from stereomend.refinement import select_backend
from stereomend.refinement.backends import Offer, Sparse

NATIVE, REFERENCE = select_backend("native", threads=2), select_backend("reference")
EVERY_BACKEND = pytest.mark.parametrize("backend", [NATIVE, REFERENCE], ids=lambda backend: backend.name)
NEAR = 0.7
# Working size and input size.
SIZES = [
    ((1, 1), (1, 1)),
    ((1, 1), (2, 2)),
    ((2, 2), (2, 2)),
    ((17, 1), (33, 1)),
    ((1, 20), (1, 33)),
    ((31, 24), (61, 47)),
    ((46, 35), (61, 47)),
    ((61, 47), (61, 47)),
    ((3, 29), (61, 47)),
    ((24, 30), (32, 40)),
]


def two_maps(working, size, seed=3):
    """A wavy map, an upload that is near it, off it or unknown, and patches of shares from 0 to 1."""
    rng = np.random.default_rng(seed)
    ratio = size[1] / working[1]

    def wavy(shape, unit):
        y, x = ((np.arange(side) + 0.5) / side for side in shape)
        return (20 + 8 * np.sin(9 * x) * np.cos(7 * y)[:, None] + rng.normal(0, 0.1, shape)) / unit

    def spoilt(u):
        return u + rng.choice([0, 0.5, 4, -30], u.shape, p=[0.6, 0.2, 0.15, 0.05])

    share = np.clip(rng.normal(0.5, 0.6, working), 0, 1)
    upload, valid = np.maximum(spoilt(wavy(size, 1)), 0), rng.random(size) < 0.9
    planes = (wavy(working, ratio), share, spoilt(wavy(working, ratio)), upload * valid)
    u, share, sample, upload = (plane.astype(np.float32) for plane in planes)
    return Offer(u, share, sample), upload, valid


def brute_force(offer, upload, valid):
    """Pixel by pixel, from `Backend.merge`'s own words."""
    size, working = upload.shape, offer.u.shape
    ratio, out = size[1] / working[1], np.zeros(size)
    u, share, sample = (plane.astype(float) for plane in offer)
    for y, x in np.ndindex(size):
        place = [(i + 0.5) * few / many - 0.5 for i, few, many in zip((y, x), working, size, strict=True)]
        own = ratio * between(u, place)
        row, column = (int(i + 0.5) for i in place)
        part = between(share, place)
        around = np.s_[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        chosen = ratio * sample[around][share[around] > 0.5]
        fits = chosen.size > 0 and chosen.min() - 1 <= upload[y, x] <= chosen.max() + 1
        judged = ratio * sample[row, column] if share[row, column] > 0.5 else own
        out[y, x] = own
        if valid[y, x] and abs(upload[y, x] - own) < NEAR:
            out[y, x] = part * upload[y, x] + (1 - part) * own
        elif valid[y, x] and part > 0.5:
            out[y, x] = upload[y, x] if fits else judged
    return np.maximum(out, 0)


def between(plane, place):
    """The value at a place between pixels; borders are repeated."""
    whole = [int(np.floor(i)) for i in place]
    total = 0.0
    for dy, dx in np.ndindex(2, 2):
        inside = tuple(np.clip((whole[0] + dy, whole[1] + dx), 0, np.subtract(plane.shape, 1)))
        weights = (1 - abs(i - w - d) for i, w, d in zip(place, whole, (dy, dx), strict=True))
        total += np.prod(list(weights)) * plane[inside]
    return total


def turns_on_the_last_bit(found, expected):
    """Where a comparison fell the other way."""
    return np.abs(found - expected) > 1e-4


@EVERY_BACKEND
@pytest.mark.parametrize(("working", "size"), SIZES)
def test_two_maps_are_put_together_as_told(working, size, backend):
    offer, upload, valid = two_maps(working, size)
    found = backend.merge(offer, upload, valid, NEAR)
    assert found.shape == size
    assert turns_on_the_last_bit(found, brute_force(offer, upload, valid)).sum() <= size[0] * size[1] // 1000


@pytest.mark.parametrize(("working", "size"), [((360, 473), (479, 631)), ((240, 316), (479, 631))])
def test_large_maps_put_together_match_the_reference(working, size):
    state = two_maps(working, size)
    found, expected = (backend.merge(*state, NEAR) for backend in (NATIVE, REFERENCE))
    assert turns_on_the_last_bit(found, expected).mean() < 1e-4


@EVERY_BACKEND
def test_a_pixel_that_was_never_sampled_and_fits_none_is_replaced(backend):
    u = np.full((4, 6), 5, np.float32)
    offer = Offer(u, np.ones_like(u), u)
    upload = np.full((8, 12), 10, np.float32)
    upload[3, 5], upload[3, 7] = 30, 11.5
    valid = np.ones(upload.shape, bool)
    found = backend.merge(offer, upload, valid, NEAR)
    assert (found == np.where(upload == 10, upload, 10)).all()
    upload[3, 7] = 10.9
    assert backend.merge(offer, upload, valid, NEAR)[3, 7] == np.float32(10.9)


@EVERY_BACKEND
def test_what_is_put_together_is_never_below_0(backend):
    offer, upload, valid = two_maps((6, 8), (8, 11))
    assert (backend.merge(offer._replace(u=-offer.u), upload, valid, NEAR) >= 0).all()


def image_of(size, kind, seed=5):
    """Noise of a dtype, with or without colours."""
    rng = np.random.default_rng(seed)
    return rng.integers(0, np.iinfo(kind.dtype).max + 1, (*size, *kind.axes), kind.dtype)


class Kind(NamedTuple):
    """What images are made of."""

    dtype: type
    axes: tuple[int, ...]


KINDS = [Kind(dtype, axes) for dtype in (np.uint8, np.uint16) for axes in ((), (3,))]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("working", "size"), [*SIZES, ((101, 333), (479, 631))])
def test_shrunk_images_match_the_reference(working, size, kind):
    image = image_of(size, kind)
    (channels, left), (expected, expected_left) = (b.shades(image, working) for b in (NATIVE, REFERENCE))
    assert np.allclose(channels, expected, rtol=0, atol=1e-4)
    assert np.allclose(left, expected_left, rtol=0, atol=1e-4)
    right, expected_right = (backend.grey(image, working) for backend in (NATIVE, REFERENCE))
    assert np.allclose(right, expected_right, rtol=0, atol=1e-4)


@pytest.mark.parametrize(("working", "size"), SIZES)
def test_shrunk_planes_and_masks_match_the_reference(working, size):
    plane = np.random.default_rng(6).uniform(-9, 40, size).astype(np.float32)
    for samples in (plane, plane > 3):
        found, expected = (backend.shrink(samples, working) for backend in (NATIVE, REFERENCE))
        assert np.allclose(found, expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("scale", [0.5, 0.75])
def test_shrunk_planes_are_those_of_opencv_to_the_last_bit(scale):
    """What `robust` decides turns on it here and there."""
    plane = np.random.default_rng(7).uniform(0, 255, (48, 64)).astype(np.float32)
    size = (round(48 * scale), round(64 * scale))
    assert (NATIVE.shrink(plane, size) == cv2.resize(plane, size[::-1], interpolation=cv2.INTER_AREA)).all()


def test_images_that_share_their_memory_with_others_are_shrunk_too():
    image = image_of((20, 30), KINDS[1])
    shown = image[::2, ::-1]
    for found, expected in zip(
        NATIVE.shades(shown, (7, 20))[0], NATIVE.shades(shown.copy(), (7, 20))[0], strict=True
    ):
        assert (found == expected).all()


@pytest.mark.parametrize(("working", "size"), [*SIZES, ((360, 473), (479, 631))])
def test_changes_of_size_are_bitwise_equal_for_any_number_of_threads(working, size):
    state = two_maps(working, size)
    results = []
    for threads in (1, 2, 5):
        backend = select_backend("native", threads)
        planes = [
            backend.merge(*state, NEAR),
            backend.shrink(state[1], working),
            backend.shrink(state[2], working),
        ]
        for kind in KINDS:
            planes += [
                *backend.shades(image_of(size, kind), working)[0],
                backend.grey(image_of(size, kind), working),
            ]
        results.append([plane.tobytes() for plane in planes])
    assert results[0] == results[1] == results[2]


@pytest.mark.parametrize("name", _native.instruction_sets())
def test_every_instruction_set_puts_maps_together_alike(name):
    offer, upload, valid = two_maps((46, 35), (61, 47))
    found = _native.Engine(2, name).merge(*offer, upload, valid, NEAR, 0.5)
    assert turns_on_the_last_bit(found, NATIVE.merge(offer, upload, valid, NEAR)).sum() <= 1


def test_maps_that_do_not_fit_are_refused():
    offer, upload, valid = two_maps((6, 8), (8, 11))
    calls = (
        lambda: NATIVE.merge(offer._replace(share=offer.share[:3]), upload, valid, NEAR),
        lambda: NATIVE.merge(offer, upload, valid[:, :5].copy(), NEAR),
        lambda: NATIVE.merge(offer, upload[:5], valid[:5], NEAR),
    )
    for call in calls:
        with pytest.raises(ValueError, match=r"planes differ in shape|expected no smaller sides"):
            call()


@pytest.mark.parametrize(
    ("samples", "size", "error"),
    [
        (np.zeros((4, 6), np.float64), (2, 3), TypeError),
        (np.zeros((4, 6, 2), np.uint8), (2, 3), ValueError),
        (np.zeros((4, 6, 3), np.float32), (2, 3), ValueError),
        (np.zeros(6, np.uint8), (1, 3), ValueError),
        (np.zeros((0, 6), np.uint8), (1, 3), ValueError),
        (np.zeros((4, 6), np.uint8), (5, 3), ValueError),
        (np.zeros((4, 6), np.uint8), (2, 0), ValueError),
        (np.zeros((8, 6), np.uint8)[::2], (2, 3), TypeError),
    ],
)
def test_samples_that_cannot_be_shrunk_are_refused(samples, size, error):
    with pytest.raises(error):
        _native.Engine(1).shrink(samples, *size)


def sparse_map(size, seed=5):
    """Disparities in quarters, of which some are unknown."""
    rng = np.random.default_rng(seed)
    valid = rng.random(size) < 0.6
    return Sparse((rng.integers(1, 200, size) / 4 * valid).astype(np.float32), valid)


def under_centre(place, sizes, others):
    """The pixel of a picture of `others` that the centre of this one falls on."""
    return tuple((2 * i + 1) * to // (2 * of) for i, of, to in zip(place, sizes, others, strict=True))


def covered(i, few, many):
    """The pixels that pixel `i` of `few` covers of `many`, and how much of each."""
    begin, end = i * many / few, (i + 1) * many / few
    return [(k, min(end, k + 1) - max(begin, k)) for k in range(int(begin), min(many, int(np.ceil(end))))]


@EVERY_BACKEND
@pytest.mark.parametrize(("working", "size"), SIZES)
def test_means_are_taken_over_what_is_known(working, size, backend):
    sparse = sparse_map(size)
    u, valid = backend.shrink_sparse(sparse, working)
    for y, x in np.ndindex(working):
        shares = [
            (sparse.u[row, column], sparse.valid[row, column], a * b)
            for row, a in covered(y, working[0], size[0])
            for column, b in covered(x, working[1], size[1])
        ]
        whole = sum(share for *_, share in shares)
        known = sum(share for _, is_known, share in shares if is_known)
        # Rounding decides what is exactly half.
        if abs(known / whole - 0.5) > 1e-4:
            assert valid[y, x] == (known / whole > 0.5)
        if valid[y, x]:
            mean = sum(value * share for value, is_known, share in shares if is_known) / known
            assert u[y, x] == pytest.approx(mean * working[1] / size[1], rel=1e-4)
        else:
            assert u[y, x] == 0


@EVERY_BACKEND
@pytest.mark.parametrize(("working", "size"), SIZES)
def test_samples_are_the_pixels_that_centres_fall_on(working, size, backend):
    sparse = sparse_map(size)
    u, valid = backend.sample_sparse(sparse, working)
    for y, x in np.ndindex(working):
        row, column = (
            (2 * i + 1) * many // (2 * few) for i, few, many in zip((y, x), working, size, strict=True)
        )
        assert u[y, x] == pytest.approx(sparse.u[row, column] * working[1] / size[1], rel=1e-6)
        assert valid[y, x] == sparse.valid[row, column]
