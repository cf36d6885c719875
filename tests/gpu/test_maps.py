"""What a GPU computes, against `native` and `reference`: the bars are those of the emulated device."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from problems import (
    NATIVE,
    ONE_WARP_PX,
    PARTS,
    PRESETS,
    REFERENCE,
    bars,
    case_of,
    near,
    out_of_the_image,
    problem_of,
    solved,
    upload_of,
)

from stereomend.refinement import refine


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("size", [(64, 48), (61, 47), (33, 1), (128, 96), (360, 288), (640, 512)])
def test_every_preset_ends_where_the_cpu_does(gpu, size, preset):
    problem, params = problem_of(preset, *size)
    oracle = REFERENCE if size[0] <= 128 else NATIVE
    assert near(gpu.globally(problem, params).u, oracle.globally(problem, params).u)


@pytest.mark.parametrize("size", [(1, 1), (33, 1), (1, 33), (2, 3), (61, 47), (67, 130), (9, 150)])
@pytest.mark.parametrize("part", PARTS)
def test_one_warp_matches_the_reference_with_every_part_of_the_model(gpu, part, size):
    case = case_of(part, size)
    assert np.abs(solved(gpu, case) - solved(REFERENCE, case)).max() <= ONE_WARP_PX


@pytest.mark.parametrize("iterations", [1, 7, 10, 11, 30])
@pytest.mark.parametrize("size", [(64, 65), (65, 64), (108, 109), (70, 152)])
def test_however_iterations_are_cut_into_launches_they_are_the_same(gpu, size, iterations):
    case = case_of("all", size, iterations=iterations, warps=2)
    assert np.abs(solved(gpu, case) - solved(REFERENCE, case)).max() <= 2 * ONE_WARP_PX


def test_disparities_out_of_the_image_match_the_reference(gpu):
    case = out_of_the_image("all")
    assert np.allclose(solved(gpu, case), solved(REFERENCE, case), rtol=5e-6, atol=ONE_WARP_PX)


def test_the_prior_replaces_what_coarser_levels_found_where_it_does_on_the_cpu(gpu):
    problem, params = bars()
    assert near(gpu.globally(problem, params).u, REFERENCE.globally(problem, params).u)


@pytest.mark.parametrize("preset", PRESETS)
def test_the_same_bytes_come_again_and_again_whatever_was_solved_between(gpu, preset):
    """A race would not give the same bytes each time."""
    problem, params = problem_of(preset, 331, 257)
    other, others = problem_of("robust", 61, 47)
    first = gpu.globally(problem, params).u.tobytes()
    for _ in range(10):
        gpu.globally(other, others)
        assert gpu.globally(problem, params).u.tobytes() == first


def test_threads_that_share_a_device_get_their_own_maps(gpu):
    problems = [problem_of("robust", 80 + 16 * i, 64) for i in range(4)]
    alone = [gpu.globally(*problem).u.tobytes() for problem in problems]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda problem: gpu.globally(*problem).u.tobytes(), 5 * problems))
    assert together == 5 * alone


@pytest.mark.parametrize("preset", PRESETS)
def test_a_whole_refinement_is_that_of_the_cpu(gpu, preset):
    pair, broken = upload_of(720, 576)
    arrays = pair.left, pair.right, broken
    found, expected = (refine(*arrays, preset=preset, backend=name) for name in ("cuda", "native"))
    assert near(found.disparity, expected.disparity)
    assert found.meta["backend"] == "cuda"
    assert found.meta["device"] in gpu.reason
