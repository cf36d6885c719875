"""What a solve costs, counted by the emulated device from the kernels themselves."""

from functools import cache

import device_work
import pytest
from fakecuda import run
from problems import problem_of

from stereomend.refinement.backends import cuda_plan as plan
from stereomend.refinement.pyramid import level_sizes

pytestmark = pytest.mark.usefixtures("emulated")

WIDTH, HEIGHT = 360, 288
UNFUSED_BYTES = 48  # u_bar, p_x, p_y read and p written; u, p, a, b read and u, u_bar written: 12 floats
SHORTER = {"released": {}, "paper": {"warps": 3}, "robust": {"warps": 2, "coarse_warps": 2}}


@cache
def counted(preset):
    """Traffic per warp does not depend on how many warps there are."""
    problem, params = problem_of(preset, WIDTH, HEIGHT, **SHORTER[preset])
    return params, run(device_work.globally, problem=problem, params=params)[0]


def pixel_iterations(params):
    """Of all levels together."""
    sizes = level_sizes((HEIGHT, WIDTH), params)
    coarse = (params.coarse_warps or params.warps) * (params.coarse_iterations or params.iterations)
    counts = [params.warps * params.iterations] + [coarse] * (len(sizes) - 1)
    return sum(h * w * count for (h, w), count in zip(sizes, counts, strict=True))


def traffic(counters):
    return sum(kernel.global_read + kernel.global_written for kernel in counters)


@pytest.mark.parametrize("preset", SHORTER)
def test_an_iteration_moves_a_quarter_of_the_bytes_of_one_that_is_not_fused(preset):
    params, first = counted(preset)
    iterating = [kernel for name, kernel in first.kernels.items() if name.startswith("iterate")]
    per_iteration = traffic(iterating) / pixel_iterations(params)
    everything = traffic(first.kernels.values()) / pixel_iterations(params)
    print(f"{preset}: {per_iteration:.2f} bytes per pixel and iteration, {everything:.2f} of all kernels")
    assert per_iteration <= 12 == UNFUSED_BYTES / 4


def test_released_takes_few_launches():
    launches = sum(kernel.launches for kernel in counted("released")[1].kernels.values())
    print(f"released at {WIDTH} x {HEIGHT}: {launches} launches")
    assert launches <= 150


@pytest.mark.parametrize("preset", SHORTER)
def test_a_solve_waits_once_at_its_end(preset):
    assert counted(preset)[1].host.synchronisations == 1


def test_only_the_first_solve_of_a_size_allocates():
    problem, params = problem_of("robust", 61, 47)
    solves = run(device_work.globally, problem=problem, params=params, repeats=3)
    assert [solve.host.allocations > 0 for solve in solves] == [True, False, False]


@pytest.mark.parametrize("preset", SHORTER)
def test_every_pixel_comes_down_once_and_none_goes_up_twice(preset):
    _, first = counted(preset)
    plane = 4 * WIDTH * HEIGHT
    assert first.host.bytes_to_host == plane
    assert first.host.bytes_to_device <= {"released": 3, "paper": 3, "robust": 9}[preset] * plane


def test_at_least_six_iterations_go_into_a_launch_where_there_are_as_many():
    assert plan.MOST_FUSED >= 6
    assert all(min(plan.laps((288, 360), count)) >= 6 for count in range(6, 11))
    assert all(min(plan.laps((288, 360), count)) >= 5 for count in range(11, 500))


def test_no_plane_of_descriptors_is_ever_written():
    """Eight planes each of both images would be 64 bytes per pixel and warp; two coefficients are 8."""
    params, first = counted("released")
    pixels = pixel_iterations(params) / params.iterations
    assert first.kernels["linearise"].global_written == 8 * pixels
