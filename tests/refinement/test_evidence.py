"""What the pair says for a map: windows, speckles, colour edges, confidence."""

import math

import numpy as np
import pytest

from stereomend.phantom import break_disparity, make_phantom
from stereomend.refinement import parse_params, select_backend
from stereomend.refinement.backends import SpeckleRule
from stereomend.refinement.evidence import (
    edge_weights,
    evidence_confidence,
)
from stereomend.refinement.pyramid import Sparse
from stereomend.refinement.scene import make_scene
from stereomend.refinement.stage_params import GdrParams

SHAPES = [(1, 1), (1, 33), (33, 1), (2, 3), (61, 47)]
ROBUST = parse_params({"preset": "robust"})


@pytest.fixture(scope="module", params=["native", "reference"])
def backend(request):
    return select_backend(request.param, threads=2)


@pytest.fixture(scope="module")
def phantom():
    return make_phantom(312, 320, 256, instrument=True)


@pytest.fixture(scope="module")
def scene(phantom, backend):
    return make_scene(phantom.pair, phantom.pair.shape, ROBUST.ldr, backend)


def patches(u, valid, step):
    """Flood fill: from pixel to neighbouring pixel as long as u changes by at most `step`.

    A size doubles with each side of the picture that the patch touches.
    """
    (height, width), label, sizes = u.shape, np.full(u.shape, -1), []
    for start in map(tuple, np.argwhere(valid)):
        if label[start] >= 0:
            continue
        label[start], open_ends, size, sides = len(sizes), [start], 0, set()
        while open_ends:
            y, x = open_ends.pop()
            size += 1
            sides |= {name for name, at in (("top", y), ("left", x)) if at == 0}
            sides |= {name for name, at in (("bottom", y - height), ("right", x - width)) if at == -1}
            for there in ((y + 1, x), (y - 1, x), (y, x + 1), (y, x - 1)):
                inside = 0 <= there[0] < u.shape[0] and 0 <= there[1] < u.shape[1]
                if inside and valid[there] and label[there] < 0 and abs(u[there] - u[y, x]) <= step:
                    label[there] = label[start]
                    open_ends.append(there)
        sizes.append(size * 2 ** len(sides))
    return label, np.array(sizes)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("share", "step"), [(0.0013, 1.0), (0.0071, 0.5), (0.21, 1.0), (0.83, 3.0)])
def test_speckles_are_the_small_patches_of_a_flood_fill(shape, share, step, backend):
    rng = np.random.default_rng(2)
    valid = rng.random(shape) < 0.9
    u = rng.choice([2, 2.5, 3, 3.5, 6, 9.0625, 40], shape, p=[0.3, 0.2, 0.2, 0.1, 0.1, 0.05, 0.05]) * valid
    label, sizes = patches(u, valid, step)
    small = np.append(sizes <= math.floor(share * u.size), False)
    rule = SpeckleRule(math.floor(share * u.size), step)
    assert (backend.speckles(u.astype(np.float32), valid, rule) == small[label]).all()


def test_one_wrong_pixel_is_a_speckle_and_a_large_patch_is_none(backend):
    u = np.full((40, 50), 7.0)
    u[10, 10], u[20:30, 20:30] = 15, 12
    found = backend.speckles(u, u > 0, SpeckleRule.of(0.001, u))
    assert np.argwhere(found).tolist() == [[10, 10]]


@pytest.mark.parametrize(
    ("part", "times"),
    [
        (np.s_[7:11, 9:12], 1),
        (np.s_[:4, 9:12], 2),
        (np.s_[36:, 9:12], 2),
        (np.s_[7:11, :3], 2),
        (np.s_[7:11, 47:], 2),
        (np.s_[:4, 47:], 4),
        (np.s_[36:, :3], 4),
    ],
)
def test_what_the_frame_cuts_off_counts_as_if_mirrored_there(backend, part, times):
    u = np.full((40, 50), 7.0, np.float32)
    u[part] = 15
    for largest, found in ((12 * times - 1, 0), (12 * times, 12)):
        assert np.count_nonzero(backend.speckles(u, u > 0, SpeckleRule(largest))) == found


def test_edge_weights_follow_the_largest_channel(backend):
    """A step of a tenth of the range along x and one of three tenths along y meet in one pixel."""
    red, green, blue = np.full((3, 3, 4), 100.0)
    green[:, 2:] += 25.5
    blue[2:] += 76.5
    params = GdrParams(edge_level=102.0, edge_power=0.8, edge_floor=0.03)
    along_x, along_y = (math.exp(-(share**0.8)) for share in (0.25, 0.75))
    expected = [[1, along_x, 1, 1], [along_y] * 4, [1, along_x, 1, 1]]
    assert np.allclose(edge_weights((red, green, blue), params, backend), expected)
    both = math.exp(-(math.hypot(0.25, 0.75) ** 0.8))
    assert edge_weights((green + blue,), params, backend)[1, 1] == pytest.approx(both)


def test_edge_weights_stay_above_their_floor_and_have_the_backend_s_type(backend):
    black_and_white = backend.plane(np.array([[0, 255, 0, 0]]))
    weight = edge_weights((black_and_white,), GdrParams(edge_level=10, edge_floor=0.03), backend)
    assert weight.dtype == black_and_white.dtype
    assert weight.shape == (1, 4)
    assert weight[0] == pytest.approx([0.03, 0.03, 1, 1])
    assert edge_weights((black_and_white,), GdrParams(edge_level=None), backend) is None


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("power", [0.01, 0.8, 4])
def test_a_plain_picture_of_any_size_has_no_edge(shape, power, backend):
    plain = np.full(shape, 80.0, np.float32)
    params = ROBUST.gdr.model_copy(update={"edge_power": power})
    assert (edge_weights((plain, plain + 1, plain), params, backend) == 1).all()


def test_the_truth_has_more_evidence_than_the_truth_moved(phantom, scene, backend):
    seen = ~phantom.occluded
    truth = backend.plane(phantom.truth)
    offsets = (0, -3, -1, 1, 3)
    at_truth, *others = backend.evidence(
        scene.left, scene.right, [truth + truth.dtype.type(off) for off in offsets]
    )
    for beside in others:
        assert at_truth[seen].mean() > beside[seen].mean() + 0.3
        assert np.mean(at_truth[seen] > beside[seen]) > 0.9


def test_confidence_from_evidence_is_high_where_the_map_is_right(phantom, scene, backend):
    broken = break_disparity(phantom, 312)
    sparse = Sparse(backend.plane(broken.values), broken.valid)
    confidence = evidence_confidence(sparse, scene, ROBUST.ldr, backend)
    error, seen = np.abs(broken.values - phantom.truth), ~phantom.occluded & broken.valid
    assert ((confidence >= 0) & (confidence <= 1)).all()
    assert np.mean(confidence[seen & (error < 0.3)] > 0.3) > 0.7
    assert np.mean(confidence[broken.valid & (error > 4)] > 0.3) < 0.1
    assert not confidence[~broken.valid].any()


def test_nothing_is_trusted_in_glints_where_hidden_or_where_a_network_says_next_to_nothing(
    phantom, scene, backend
):
    u = backend.plane(phantom.truth)
    u[100:140, 100:140] = 0.4
    everywhere = np.ones(u.shape, bool)
    confidence = evidence_confidence(Sparse(u, everywhere), scene, ROBUST.ldr, backend)
    assert not confidence[100:140, 100:140].any()
    assert (~scene.matte).any()
    assert not confidence[~scene.matte].any()
    outside = np.arange(u.shape[1]) < u
    assert not confidence[outside].any()
    assert confidence[~phantom.occluded].mean() > 0.4
