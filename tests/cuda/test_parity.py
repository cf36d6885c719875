"""The kernels, run as PTX by the emulated device, against `native` and `reference`."""

from functools import cache

import device_work
import numpy as np
import pytest
from fakecuda import run
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
from stereomend.refinement.pyramid import level_sizes

pytestmark = pytest.mark.usefixtures("emulated")

ORDERS = ["forward", "reverse", "shuffled:7"]
SIZES = [(64, 48), (61, 47), (33, 1), (128, 96)]


@cache
def posed(preset, width, height):
    problem, params = problem_of(preset, width, height)
    return problem, params, [backend.globally(problem, params).u for backend in (NATIVE, REFERENCE)]


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(("width", "height"), SIZES)
def test_every_preset_ends_where_the_cpu_does_in_every_order_of_threads(width, height, preset):
    problem, params, expected = posed(preset, width, height)
    found = [run(device_work.globally, order=order, problem=problem, params=params)[0] for order in ORDERS]
    assert all(near(found[0].u, map_) for map_ in expected)
    assert len({counted.u.tobytes() for counted in found}) == 1
    assert found[0].host.unwritten_bytes_to_host == 0


def test_the_largest_of_them_has_at_least_three_levels():
    assert all(len(level_sizes((96, 128), posed(preset, 128, 96)[1])) >= 3 for preset in PRESETS)


def test_work_that_waits_in_a_queue_gives_the_same_bytes_again_and_again():
    problem, params, expected = posed("robust", 61, 47)
    eager = run(device_work.globally, problem=problem, params=params)[0].u
    lazy = run(
        device_work.globally, env={"FAKE_CUDA_ASYNC": "lazy"}, problem=problem, params=params, repeats=3
    )
    assert {one.u.tobytes() for one in lazy} == {eager.tobytes()}
    assert near(eager, expected[1])


@cache
def solved_one_by_one(size):
    return [[solved(backend, case_of(part, size)) for part in PARTS] for backend in (NATIVE, REFERENCE)]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("size", [(1, 1), (33, 1), (1, 33), (2, 3), (61, 47), (67, 130), (9, 150)])
def test_one_warp_matches_the_reference_with_every_part_of_the_model(size, order):
    cases = [case_of(part, size) for part in PARTS]
    found = run(device_work.solve, order=order, cases=cases)
    for expected in solved_one_by_one(size):
        errors = [np.abs(u - plane).max() for u, plane in zip(found, expected, strict=True)]
        assert max(errors) <= ONE_WARP_PX


@pytest.mark.parametrize("part", PARTS)
def test_each_part_of_the_model_has_a_say(part):
    """Or matching the reference would say nothing."""
    changed = solved(NATIVE, case_of(part, (61, 47))) - solved(NATIVE, case_of("plain", (61, 47)))
    assert (np.abs(changed).max() > 0.05) == (part != "plain")


@pytest.mark.parametrize("iterations", [1, 7, 10, 11, 30])
def test_however_iterations_are_cut_into_launches_they_are_the_same(iterations):
    """Sizes at which tiles end with the image, one pixel before and one after it."""
    sizes = [(64, 65), (65, 64), (108, 109), (70, 152)]
    cases = [case_of("all", size, iterations=iterations, warps=2) for size in sizes]
    found = run(device_work.solve, cases=cases)
    errors = [np.abs(u - solved(REFERENCE, case)).max() for u, case in zip(found, cases, strict=True)]
    assert max(errors) <= 2 * ONE_WARP_PX


@pytest.mark.parametrize("part", ["plain", "averaging", "all"])
def test_disparities_out_of_the_image_match_the_reference(part):
    case = out_of_the_image(part)
    found = run(device_work.solve, cases=[case])[0]
    assert np.allclose(found, solved(REFERENCE, case), rtol=5e-6, atol=ONE_WARP_PX)


@pytest.mark.parametrize("averaging_px", [0.5, 1.3, 4.0])
def test_every_window_matches_the_reference(averaging_px):
    """Also windows wider than the picture."""
    cases = []
    for size in [(1, 1), (5, 47), (47, 5), (61, 47)]:
        state, params, weight, guide = case_of("plain", size)
        cases.append((state, params.model_copy(update={"averaging_px": averaging_px}), weight, guide))
    found = run(device_work.solve, cases=cases)
    errors = [np.abs(u - solved(REFERENCE, case)).max() for u, case in zip(found, cases, strict=True)]
    assert max(errors) <= ONE_WARP_PX


def test_the_prior_replaces_what_coarser_levels_found_where_it_does_on_the_cpu():
    problem, params = bars()
    expected = REFERENCE.globally(problem, params).u
    without = REFERENCE.globally(problem, params.model_copy(update={"reuse_margin": None})).u
    assert np.mean(np.abs(expected - without) > 1) > 0.05
    assert near(run(device_work.globally, problem=problem, params=params)[0].u, expected)


@pytest.mark.parametrize(("longest", "on_device"), [(61, True), (60, False)])
def test_a_picture_too_long_for_a_launch_is_left_to_the_cpu(longest, on_device):
    case = case_of("all", (61, 47))
    found, kernels = run(device_work.solve_too_long, case=case, longest=longest)
    assert bool(kernels) == on_device
    assert np.abs(found - solved(NATIVE, case)).max() <= (ONE_WARP_PX if on_device else 0)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_whole_refinement_is_that_of_the_cpu(preset):
    pair, broken = upload_of(122, 94)
    arrays = [pair.left, pair.right, broken]
    found = run(device_work.refined, pair=arrays, params={"preset": preset}, backend="cuda")
    expected = refine(*arrays, preset=preset, backend="native")
    assert near(found.disparity, expected.disparity)
    assert found.meta["backend"] == "cuda"


def test_a_mask_weighs_the_data_term_of_every_level():
    problem, params = problem_of("robust", 90, 70)
    weight = np.ones_like(problem.left)
    weight[:, :40] = 0
    problem = problem._replace(weight=weight)
    unmasked = REFERENCE.globally(problem._replace(weight=None), params).u
    expected = REFERENCE.globally(problem, params).u
    assert np.mean(np.abs(expected - unmasked) > 0.05) > 0.1
    assert near(run(device_work.globally, problem=problem, params=params)[0].u, expected)
