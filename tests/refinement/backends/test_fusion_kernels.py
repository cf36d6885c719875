"""Votes on an upload, and its share of the result: native, reference, and plain loops for the votes."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from stereomend.opencv import cv2
from stereomend.refinement import parse_params, select_backend
from stereomend.refinement.backends import CELL, ChoiceRule, Grounds, PollRule, Polls, Rivals

SIZES = [(1, 1), (1, 40), (40, 1), (33, 1), (2, 2), (8, 8), (61, 47), (64, 48), (130, 70), (200, 150)]
NATIVE, REFERENCE = select_backend("native", threads=2), select_backend("reference")
EVERY_BACKEND = pytest.mark.parametrize("backend", [NATIVE, REFERENCE], ids=lambda backend: backend.name)
FUSION = parse_params({"preset": "robust"}).fusion
POLL = PollRule(0.975, 1.125, 0.05, 0.02)
THRESHOLDS = [1 - FUSION.max_doubt, 1 - FUSION.low_doubt, 1 - FUSION.trusted_doubt]
FINE = 8  # parts of a pixel that quantised maps are rounded to


class Scene(NamedTuple):
    """Two maps and all that is known of them."""

    rivals: Rivals
    grounds: Grounds
    matte: np.ndarray
    spoilt: np.ndarray


def slow(rng, size, low, high):
    """Random values that change slowly."""
    height, width = size
    coarse = rng.uniform(low, high, (2 + height // 16, 2 + width // 16))
    return cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR).reshape(size)


def patchy(rng, size, values, side):
    """Squares, each of one of the values."""
    coarse = rng.choice(values, (1 + size[0] // side, 1 + size[1] // side))
    return np.kron(coarse, np.ones((side, side), coarse.dtype))[: size[0], : size[1]]


def maps_of(rng, size):
    """Slow changes, jumps, steep slopes, whole pixels, spikes and holes; and a map that partly agrees."""
    y, x = np.mgrid[: size[0], : size[1]]
    upload = slow(rng, size, 2, 12) + patchy(rng, size, [0, 0, 0, 9], 29)
    upload += patchy(rng, size, [0.0, 0.0, 1.5, -0.9], 23) * (x % 23)
    upload += patchy(rng, size, [0.0, 0.0, 1.2], 31) * (y % 31)
    upload = np.where(patchy(rng, size, [False, False, True], 17), np.round(upload), upload)
    u = upload + patchy(rng, size, [0, 0, 0, 0.7, -1.4, 4], 13) + slow(rng, size, -0.3, 0.3)
    upload += (rng.random(size) < 0.008) * rng.uniform(-3, 3, size)
    valid = (rng.random(size) > 0.004) & ~patchy(rng, size, [False] * 20 + [True], 9)
    return np.where(valid, np.maximum(upload, 0.6), 0), np.maximum(u, 0), valid


def scene_of(size, seed=1, *, quantised=False):
    rng = np.random.default_rng(seed)
    upload, u, valid = maps_of(rng, size)
    n = slow(rng, size, -0.1, 1) + rng.normal(0, 0.05, size)
    other = n + slow(rng, size, -0.4, 0.3) + rng.normal(0, 0.05, size)
    level = patchy(rng, size, [edge + by for edge in THRESHOLDS for by in (-0.1, -1e-3, 1e-3, 0.1)], 11)
    if quantised:
        upload, u = (np.round(plane * FINE) / FINE for plane in (upload, u))
        n, other = (np.round(plane * 64) / 64 for plane in (n, other))
        level = np.round(level * 16) / 16
    planes = upload, u, other, n, level, slow(rng, size, -0.4, 1.4).clip(0, 1)
    upload, u, other, n, level, equal = (plane.astype(np.float32) for plane in planes)
    usual, edge = (slow(rng, size, *ends).astype(np.float32) for ends in ((0.2, 0.9), (0.2, 1)))
    hidden, dark, beside = (patchy(rng, size, [False, False, True], side) for side in (15, 19, 7))
    glints, matte, spoilt = (rng.random(size) < share for share in (0.02, 0.95, 0.3))
    return Scene(
        Rivals(upload, valid, u, other, n, valid & ~hidden, ~dark),
        Grounds(level, equal, usual, edge, glints, beside),
        matte,
        spoilt,
    )


def poll(backend, scene, rule=POLL):
    return backend.poll(scene.rivals, scene.matte, scene.spoilt, rule)


def rule_of(size):
    # The scenes are noisier than what may be reached by default.
    return ChoiceRule.of(FUSION, 0.75, size[0] * size[1])._replace(spike=0.3)


def assert_same(found, expected, rel=1e-5):
    """The lead is a difference, and cancels; it is as exact as what it is the difference of."""
    for name, a, b in zip(Polls._fields, found, expected, strict=True):
        size = np.abs(expected.level if name == "lead" else b).max()
        assert a.dtype == np.float64, name
        assert a.shape == b.shape, name
        assert np.allclose(a, b, rtol=rel, atol=max(rel * size, 1e-30)), name


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("size", SIZES)
def test_polls_match_the_reference(size, seed):
    scene = scene_of(size, seed)
    for rule in (
        POLL,
        PollRule(0.1, 0.3, 0.05, 0.1),
        PollRule(20, 30, 1.0, 1.0, (-1.0, -0.5), -5.0),
        PollRule(1, 1, 0, 0.01, (0.4, 0.4)),
    ):
        assert_same(poll(NATIVE, scene, rule), poll(REFERENCE, scene, rule))


@pytest.mark.parametrize("far", [90.0, 1e4, 1e6])
def test_polls_on_a_map_that_is_far_off_match_the_reference(far):
    scene = scene_of((40, 61))
    away = scene._replace(rivals=scene.rivals._replace(upload=scene.rivals.upload + np.float32(far)))
    found = poll(NATIVE, away)
    assert_same(found, poll(REFERENCE, away))
    assert found.voted.max() > 0.1
    assert found.agreed.max() < 1e-30
    assert not found.fair.any()


def loops(scene, rule):
    """Pixel by pixel, then cell by cell."""
    rivals = scene.rivals
    shape = [math.ceil(side / CELL) for side in rivals.u.shape]
    sums, sizes = np.zeros((8, *shape)), np.zeros(shape)
    for y, x in np.ndindex(rivals.u.shape):
        upload, u, other, n = (float(rivals[k][y, x]) for k in (0, 2, 3, 4))
        here = y // CELL, x // CELL
        sizes[here] += 1
        if rivals.u_shown[y, x]:
            sums[(slice(5, 8), *here)] += 1, u, u * u
        both_shown = rivals.u_shown[y, x] and rivals.upload_shown[y, x]
        if not (both_shown and scene.matte[y, x]) or x - u <= rule.frame:
            continue
        vote = min(max((n - rule.clear[0]) / (rule.clear[1] - rule.clear[0]), 0), 1)
        agrees = vote * math.exp(-(((upload - u) / rule.tolerance) ** 2))
        told_apart = min(max((n - other) / rule.lack, 0), 1)
        sums[(slice(0, 2), *here)] += agrees + (vote - agrees) * told_apart, agrees
        if abs(upload - u) < rule.near and not scene.spoilt[y, x]:
            lead = min(max(other - n, -rule.most), rule.most)
            sums[(slice(2, 5), *here)] += vote, vote * lead, vote * n
    return Polls(*(sums / sizes))


@EVERY_BACKEND
@pytest.mark.parametrize("size", [(1, 1), (1, 40), (33, 1), (8, 8), (9, 17), (61, 47), (64, 48)])
def test_polls_are_means_over_cells_of_what_pixels_vote(size, backend):
    """Cells at the end are of fewer pixels; quantised, so that differences meet the limits exactly."""
    scene = scene_of(size, 3, quantised=True)
    for rule in (POLL, PollRule(0.7, 0.75, 0.25, 0.03, (0.25, 0.75), 2.5)):
        expected = loops(scene, rule)
        assert_same(poll(backend, scene, rule), expected)
        assert size[1] < 47 or all((np.abs(plane) > 0).mean() > 0.2 for plane in expected)


@EVERY_BACKEND
@pytest.mark.parametrize(
    ("change", "votes", "fair"),
    [
        ({}, 1, 1),
        ({"valid": False, "upload_shown": False}, 0, 0),
        ({"u_shown": False}, 0, 0),
        ({"upload_shown": False, "upload": 30}, 0, 0),
        ({"matte": False}, 0, 0),
        ({"spoilt": True}, 1, 0),
        ({"for_u": 0.3}, 0, 0),
        ({"for_u": 0.5}, 0.5, 0.5),
        ({"u": 37.0, "upload": 37.0}, 0, 0),  # the match is 3 px from the frame
        ({"u": 36.5, "upload": 36.5}, 1, 1),
        ({"upload": 6.125}, 1, 0),
        ({"upload": 9, "for_upload": 0.85}, 1, 0),
        ({"upload": 9, "for_upload": 0.875}, 0.5, 0),  # half of what it takes to tell both apart
        ({"upload": 9, "for_upload": 0.9}, 0, 0),
        ({"upload": 9, "for_upload": 1}, 0, 0),
        ({"for_upload": 1}, 1, 1),
        ({"upload": 9, "for_u": 0.5, "for_upload": 0.475}, 0.25, 0),
    ],
)
def test_who_votes_and_what_is_compared(backend, change, votes, fair):
    """R8 and R9: one pixel of column 40 in a picture that else has no vote."""
    size = (48, 64)
    no, yes = np.zeros(size, bool), np.ones(size, bool)
    planes = {"upload": 5, "valid": yes, "u": 5, "for_upload": 0.8, "for_u": 0.9, "upload_shown": yes}
    planes |= {"u_shown": yes, "matte": no.copy(), "spoilt": no}
    planes = {name: np.array(np.broadcast_to(value, size)) for name, value in planes.items()}
    planes = {k: plane if plane.dtype == bool else plane.astype(np.float32) for k, plane in planes.items()}
    planes["matte"][20, 40] = True
    for name, value in change.items():
        planes[name][20, 40] = value
    polls = backend.poll(
        Rivals(*(planes[k] for k in Rivals._fields)), planes["matte"], planes["spoilt"], POLL
    )
    assert polls.voted.sum() * CELL**2 == pytest.approx(votes, abs=1e-6)
    assert polls.fair.sum() * CELL**2 == pytest.approx(fair, abs=1e-6)
    assert (polls.voted > 0).sum() == (polls.voted[20 // CELL, 40 // CELL] > 0)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("size", SIZES)
def test_the_share_matches_the_reference(size, seed):
    scene = scene_of(size, seed)
    found, expected = (
        backend.choose(scene.rivals, scene.grounds, rule_of(size)) for backend in (NATIVE, REFERENCE)
    )
    assert found.dtype == np.float32
    assert found.shape == size
    assert (np.abs(found - expected) > 1e-5).sum() <= 1e-4 * found.size
    if found.size > 9000:
        assert min((found == 0).mean(), (found == 1).mean(), ((found > 0) & (found < 1)).mean()) > 0.05


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("size", SIZES)
def test_the_share_of_quantised_maps_is_that_of_the_reference(size, seed):
    """Lengths are whole parts of a pixel, and met exactly; margins lie between means that can be."""
    scene = scene_of(size, seed, quantised=True)
    lengths = {"near": 1.125, "step": 0.75, "spike": 0.375}
    levels = {"enough": 0.6875, "full_trust": 0.75, "high_trust": 0.8125}
    rule = rule_of(size)._replace(**lengths, **levels, win_margin=0.0203, trusted_margin=0.1807)
    for rule_here in (rule, rule._replace(rough_share=0.12, largest_patch=3)):
        found, expected = (
            backend.choose(scene.rivals, scene.grounds, rule_here) for backend in (NATIVE, REFERENCE)
        )
        assert (found == expected).all()


@pytest.mark.parametrize("size", [*SIZES, (3, 2000), (2000, 3), (2, 2500), (479, 631)])
def test_votes_and_shares_are_bitwise_equal_for_any_number_of_threads(size):
    scene, results = scene_of(size), []
    for threads in (1, 2, 5):
        backend = select_backend("native", threads)
        planes = (*poll(backend, scene), backend.choose(scene.rivals, scene.grounds, rule_of(size)))
        results.append([plane.tobytes() for plane in planes])
    assert results[0] == results[1] == results[2]


def test_a_share_does_not_depend_on_what_was_chosen_before():
    """Memory stays from one call to the next."""
    scenes = [scene_of(size, seed) for seed, size in enumerate([(130, 70), (200, 150), (64, 48), (130, 70)])]
    used = select_backend("native", threads=2)
    for scene in (*scenes, *reversed(scenes)):
        rule = rule_of(scene.rivals.u.shape)
        fresh = select_backend("native", threads=2).choose(scene.rivals, scene.grounds, rule)
        assert (used.choose(scene.rivals, scene.grounds, rule) == fresh).all()


@pytest.mark.parametrize("name", [*Rivals._fields, *Grounds._fields, "matte", "spoilt"])
def test_a_plane_that_does_not_fit_is_refused(name):
    scene, errors = scene_of((16, 24)), []
    parts = {"rivals": scene.rivals, "grounds": scene.grounds}
    for key, part in parts.items():
        if name in part._fields:
            parts[key] = part._replace(**{name: np.ascontiguousarray(getattr(part, name)[:, 1:])})
    scene = scene._replace(**parts)
    if name in ("matte", "spoilt"):
        scene = scene._replace(**{name: np.ascontiguousarray(getattr(scene, name)[:, 1:])})
    calls = [lambda: poll(NATIVE, scene)] * (name not in Grounds._fields)
    calls += [lambda: NATIVE.choose(scene.rivals, scene.grounds, rule_of((16, 24)))] * (
        name not in ("matte", "spoilt")
    )
    for call in calls:
        with pytest.raises(ValueError, match="planes differ in shape") as error:
            call()
        errors.append(error)
    assert errors
