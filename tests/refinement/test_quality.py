import numpy as np
import pytest

from stereomend.disparity import Provenance
from stereomend.phantom import make_phantom
from stereomend.refinement import refine, select_backend
from stereomend.refinement.pyramid import Sparse
from stereomend.refinement.quality import Origin, provenance_of, shares_of


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


def test_the_highest_provenance_that_applies_is_stored(backend):
    known = np.array([[True, True, True, False, True]])
    initial = Sparse(np.array([[0.9, 1.0, 1.0, 0.0, 1.0]]), known)
    origin = Origin(initial, known & [[True, True, True, True, False]])
    found = provenance_of(np.array([[1.0, 1.0, 2.0, 1.5, 1.4]]), origin, backend)
    unseen, kept, refined, filled = (Provenance[n] for n in ("UNOBSERVED", "KEPT", "REFINED", "FILLED"))
    assert found.tolist() == [[unseen, kept, refined, filled, filled]]
    assert shares_of(found) == {"kept": 0.2, "refined": 0.2, "filled": 0.4, "unobserved": 0.2}


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
