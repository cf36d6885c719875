"""Votes and the choice between two maps: native, reference, plain loops for the votes."""

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
POLL = PollRule(0.975, 1.125)
THRESHOLDS = [FUSION.min_trust, FUSION.full_trust, FUSION.high_trust]


class Scene(NamedTuple):
    """Two maps and all that is known of them."""

    rivals: Rivals
    grounds: Grounds
    matte: np.ndarray
    spoilt: np.ndarray


def rule_of(size):
    return ChoiceRule.of(FUSION, 0.75, size[0] * size[1])


def slow(rng, size, low, high):
    """Random values that change slowly."""
    height, width = size
    coarse = rng.uniform(low, high, (2 + height // 16, 2 + width // 16)).astype(np.float32)
    return cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR).reshape(size)


def patchy(rng, size, values, side=11):
    """Squares, each of one of the values."""
    coarse = rng.choice(values, (1 + size[0] // side, 1 + size[1] // side))
    return np.kron(coarse, np.ones((side, side), coarse.dtype))[: size[0], : size[1]]


def maps_of(rng, size):
    """Slow changes, jumps, steep slopes, whole pixels, spikes and holes; and another map, partly the same."""
    y, x = np.mgrid[: size[0], : size[1]]
    upload = slow(rng, size, 2, 12) + patchy(rng, size, [0, 0, 0, 9], 29)
    upload += patchy(rng, size, [0.0, 0.0, 1.5, -0.9], 23) * (x % 23) + patchy(rng, size, [0.0, 1.2], 31) * (y % 31)
    upload = np.where(patchy(rng, size, [False, False, True], 17), np.round(upload), upload)
    u = upload + patchy(rng, size, [0, 0, 0, 0.7, -1.4, 4], 13) + slow(rng, size, -0.3, 0.3)
    upload = upload + (rng.random(size) < 0.008) * rng.uniform(-3, 3, size)
    valid = (rng.random(size) > 0.004) & ~patchy(rng, size, [False] * 20 + [True], 9)
    return np.where(valid, np.maximum(upload, 0.6), 0), valid, np.maximum(u, 0)


def scene_of(size, seed, fine=None):
    """`fine`: all is rounded to so many parts of a pixel, and its evidence to 64ths."""
    rng = np.random.default_rng(seed)
    upload, valid, u = maps_of(rng, size)
    n = slow(rng, size, -0.1, 1) + rng.normal(0, 0.05, size)
    other = n + slow(rng, size, -0.4, 0.3) + rng.normal(0, 0.05, size)
    if fine:
        upload, u = np.round(upload * fine) / fine, np.round(u * fine) / fine
        n, other = np.round(n * 64) / 64, np.round(other * 64) / 64
    level = patchy(rng, size, [t + d for t in THRESHOLDS for d in (-0.1, -0.001, 0.001, 0.1)])
    equal, usual = slow(rng, size, -0.4, 1.4).clip(0, 1), slow(rng, size, 0.2, 0.9)
    rivals = Rivals(
        *(upload.astype(np.float32), valid, u.astype(np.float32), n.astype(np.float32), other.astype(np.float32)),
        valid & ~patchy(rng, size, [False, False, True], 15),
        ~patchy(rng, size, [False, False, True], 19),
    )._replace(for_upload=other.astype(np.float32), for_u=n.astype(np.float32))
    flags = (rng.random(size) < share for share in (0.02, 0.95, 0.3))
    glints, matte, spoilt = flags
    edge, beside = slow(rng, size, 0.3, 1), patchy(rng, size, [False, False, True], 7)
    planes = [np.asarray(plane, np.float32) for plane in (level, equal, usual, edge)]
    return Scene(rivals, Grounds(*planes, glints, beside), matte, spoilt)


def close_to(expected, rel=1e-5):
    """Within so much of each sum's own size: the lead is a difference, and may cancel."""
    scale = [np.abs(plane).max() for plane in expected]
    scale[Polls._fields.index("lead")] = scale[Polls._fields.index("level")]
    return lambda found: all(
        np.allclose(a, b, rtol=rel, atol=rel * size) for a, b, size in zip(found, expected, scale, strict=True)
    )
