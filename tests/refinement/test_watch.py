"""Watching a refinement changes nothing of it, and may end it."""

import numpy as np
import pytest

from stereomend.disparity import DisparityMap, StereoPair
from stereomend.refinement import describe, mend, parse_params, prepare, select_backend
from stereomend.refinement.backends.coarse_to_fine import level_sizes
from stereomend.refinement.params import PRESETS


class Enough(Exception):
    """What a watch may raise."""


@pytest.fixture(scope="module", params=["reference", "native", "native, 3 threads"])
def backend(request):
    name, _, threads = request.param.partition(", ")
    if name == "native":
        pytest.importorskip("stereomend._native")
    return select_backend(name, int(threads.split()[0]) if threads else 1)


@pytest.fixture
def mended(scene, backend):
    """Mend the scene: `mended(params, watch)`."""
    pair, upload = StereoPair(scene.left, scene.right), DisparityMap.from_array(scene.disparity)
    return lambda params, *watch: mend(prepare(pair, params, backend), upload, params, backend, *watch)


@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_a_watched_refinement_is_bitwise_the_same(mended, backend, preset):
    params, seen = parse_params({"preset": preset}), []
    alone = describe(mended(params), params, backend)
    watched = describe(mended(params, lambda *step: seen.append(step)), params, backend)
    assert seen
    for name in ("disparity", "confidence", "provenance", "input_confidence"):
        assert np.array_equal(getattr(alone, name), getattr(watched, name))


def test_stages_and_warps_are_told_in_their_order(mended):
    params, seen = parse_params({"preset": "paper", "gdr": {"warps": 3, "levels": 3}}), []
    mended(params, lambda *step: seen.append(step))
    warps = 3 * len(level_sizes((24, 32), params.gdr))
    assert seen == [("ldr", 0, 0), ("gdr", 0, 0), *(("gdr", done, warps) for done in range(warps))]


@pytest.mark.parametrize("stop", [("ldr", 0), ("gdr", 0), ("gdr", 1), ("gdr", 7)])
def test_what_a_watch_raises_ends_the_work_at_once_and_harms_nothing(mended, backend, stop):
    params, seen = parse_params({"preset": "paper"}), []

    def watch(stage, done, total):
        seen.append((stage, done))
        if (stage, done) == stop:
            raise Enough(stage)

    before = mended(params).disparity
    with pytest.raises(Enough, match=stop[0]):
        mended(params, watch)
    assert seen[-1] == stop
    assert np.array_equal(mended(params).disparity, before)
