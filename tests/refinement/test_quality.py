import numpy as np
import pytest

from stereomend.disparity import Provenance
from stereomend.phantom import make_phantom
from stereomend.refinement import refine, select_backend
from stereomend.refinement.backends import Origins, Reading, Sparse
from stereomend.refinement.quality import residuals, sampled, shares_of


def brute_force_unobserved(disparity):
    height, width = disparity.shape
    result = np.zeros(disparity.shape, bool)
    for y in range(height):
        for x in range(width):
            column = x - disparity[y, x]
            hidden = any(i - disparity[y, i] <= column - 1 for i in range(x + 1, width))
            result[y, x] = hidden or not 0 <= column <= width - 1
    return result


@pytest.fixture(params=["native", "reference"])
def backend(request):
    return select_backend(request.param, threads=2)


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (6, 40)])
def test_unobserved_is_what_falls_outside_or_behind_something_nearer(size, backend):
    disparity = np.random.default_rng(4).integers(-8, 72, size) / 8
    found = backend.unobserved(backend.plane(disparity))
    assert (found == brute_force_unobserved(disparity)).all()


def test_the_pixels_left_of_a_near_object_are_hidden(backend):
    disparity = backend.plane([[1, 1, 1, 1, 1, 4, 4, 4, 1, 1.0]])
    assert np.flatnonzero(backend.unobserved(disparity)).tolist() == [0, 3, 4]


@pytest.mark.parametrize("width", [1, 3, 4, 5, 40])
def test_what_is_hidden_or_hardly_shown_rises_by_half_a_pixel_per_pixel(width, backend):
    rng = np.random.default_rng(width)
    valid = rng.random((30, width)) < 0.8
    u = np.where(valid, 20 + np.cumsum(rng.choice([0, 0.25, 0.5, 0.75], valid.shape), axis=1), 0)
    unobserved = brute_force_unobserved(u)
    steep = np.zeros_like(valid)
    for y, x in np.ndindex(valid.shape):
        if 2 <= x < width - 2:
            before, after = x - 2 - u[y, x - 2], x + 2 - u[y, x + 2]
            steep[y, x] = valid[y, x - 2] and valid[y, x + 2] and after - before <= 2
    shown, hidden = backend.shown(Sparse(backend.plane(u), valid))
    assert (shown == (valid & ~unobserved)).all()
    assert (hidden == (valid & unobserved | steep)).all()
    assert width < 40 or (0.1 < steep.mean() < 0.9 and (valid & unobserved & ~steep).any())


def test_the_highest_provenance_that_applies_is_stored(backend):
    known = np.array([[True, True, True, False, True]])
    initial = Sparse(np.array([[0.9, 1.0, 1.0, 0.0, 1.0]]), known)
    kept = np.array([[True, True, True, True, False]])
    found, counts = backend.tell(np.array([[1.0, 1.0, 2.0, 1.5, 1.4]]), Origins(initial, kept))
    unseen, kept, refined, filled = (Provenance[n] for n in ("UNOBSERVED", "KEPT", "REFINED", "FILLED"))
    assert found.tolist() == [[unseen, kept, refined, filled, filled]]
    assert counts == [1, 1, 2, 1]
    assert shares_of(counts) == {"kept": 0.2, "refined": 0.2, "filled": 0.4, "unobserved": 0.2}


def test_a_sample_of_the_rows_tells_the_residual_of_all(backend):
    phantom = make_phantom(5, 400, 320)
    left, right = (backend.grey(image, image.shape[:2]) for image in (phantom.pair.left, phantom.pair.right))
    true = Sparse(backend.plane(phantom.truth), np.ones(phantom.truth.shape, bool))
    off = true._replace(u=backend.plane(phantom.truth + 0.5))
    whole, some = (
        residuals(left, [Reading(right, *of(sparse)) for sparse in (true, off)], backend)
        for of in (lambda sparse: sparse, sampled)
    )
    assert some == pytest.approx(whole, rel=0.03)
    assert some[0] < 0.8 * some[1]


@pytest.mark.parametrize(
    ("height", "width", "apart"), [(1, 1, 1), (250, 320, 1), (300, 400, 2), (9, 20_000, 3), (432, 540, 4)]
)
def test_bands_of_eight_rows_are_so_far_apart_that_60_000_pixels_are_left(height, width, apart):
    valid = sampled(Sparse(np.ones((height, width)), np.ones((height, width), bool))).valid
    assert np.flatnonzero(valid.all(1)).tolist() == [y for y in range(height) if y // 8 % apart == 0]
    assert valid.any(1).sum() == valid.all(1).sum()


def brute_force_kinds(u, origins):
    """Pixel by pixel, from what `Provenance` says of its kinds."""
    (initial, valid), kept, scene, within = origins
    hidden, kinds = brute_force_unobserved(u), np.zeros(u.shape, int)
    for y, x in np.ndindex(u.shape):
        row, column = (
            (2 * i + 1) * few // (2 * many) for i, few, many in zip((y, x), kept.shape, u.shape, strict=True)
        )
        if hidden[y, x] or not (scene is None or scene[y, x]):
            kinds[y, x] = Provenance.UNOBSERVED
        elif not (valid[y, x] and kept[row, column]):
            kinds[y, x] = Provenance.FILLED
        elif abs(u[y, x] - initial[y, x]) > within:
            kinds[y, x] = Provenance.REFINED
    return kinds


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize(
    ("working", "size"), [((1, 1), (1, 1)), ((1, 5), (1, 9)), ((17, 1), (33, 1)), ((12, 24), (23, 61))]
)
def test_every_pixel_is_told_as_its_kind_says(working, size, masked, backend):
    rng = np.random.default_rng(8)
    u = rng.integers(0, 40, size) / 8
    valid = rng.random(size) < 0.8
    initial = Sparse((u + rng.choice([-0.5, 0, 0.5, 0.625], size)) * valid, valid)
    origins = Origins(initial, rng.random(working) < 0.7, rng.random(size) < 0.8 if masked else None)
    found, counts = backend.tell(u, origins)
    assert (found == brute_force_kinds(u, origins)).all()
    assert counts == [np.count_nonzero(found == kind) for kind in Provenance]


@pytest.fixture(scope="module")
def phantom():
    return make_phantom(5, 320, 256)


def warnings_for(left, right, disparity):
    return refine(left, right, disparity, preset="released").quality["warnings"]


def test_a_sound_input_raises_no_warning(phantom):
    assert warnings_for(phantom.pair.left, phantom.pair.right, phantom.truth) == []


def test_swapped_views_are_noticed(phantom):
    assert "views-swapped" in warnings_for(phantom.pair.right, phantom.pair.left, phantom.truth)


def test_a_vertical_offset_is_noticed(phantom):
    assert warnings_for(phantom.pair.left, np.roll(phantom.pair.right, 8, axis=0), phantom.truth) == [
        "not-rectified"
    ]


@pytest.mark.parametrize("factor", [0.25, 4])
def test_a_wrong_scale_is_noticed(phantom, factor):
    assert "scale-suspect" in warnings_for(phantom.pair.left, phantom.pair.right, phantom.truth * factor)


@pytest.mark.parametrize("part", [np.s_[:40], np.s_[-40:], np.s_[100:150]])
def test_a_wrong_scale_is_noticed_wherever_the_disparity_is_known(phantom, part):
    known = np.zeros_like(phantom.truth)
    known[part] = phantom.truth[part] / 4
    assert "scale-suspect" in warnings_for(phantom.pair.left, phantom.pair.right, known)
