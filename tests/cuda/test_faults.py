"""A device that fails: what is lost with it, and what is not."""

import device_work
import numpy as np
import pytest
from fakecuda import Failed, run
from problems import NATIVE, problem_of

from stereomend.refinement.backends.cuda_faults import STICKY

pytestmark = pytest.mark.usefixtures("emulated")

ILLEGAL_ADDRESS, OUT_OF_RESOURCES = 700, 701


@pytest.fixture(scope="module")
def posed():
    """A problem, its parameters, what the device and what the CPU makes of it."""
    problem, params = problem_of("robust", 40, 31, warps=1, coarse_warps=1)
    (first,) = run(device_work.globally, problem=problem, params=params)
    return problem, params, first, NATIVE.globally(problem, params).u


@pytest.mark.parametrize("code", STICKY)
def test_an_error_that_stays_is_named(posed, code):
    problem, params, *_ = posed
    with pytest.raises(
        Failed, match=rf"^DeviceFault: the GPU failed with CUDA error {code} \({STICKY[code]}\)"
    ):
        run(device_work.globally, problem=problem, params=params, env={"FAKE_CUDA_FAIL_LAUNCH": f"3:{code}"})


@pytest.mark.parametrize("mode", ["eager", "lazy"])
def test_once_lost_the_device_stays_lost(posed, mode):
    problem, params, *_ = posed
    said = run(device_work.after_a_fault, problem=problem, params=params, env={"FAKE_CUDA_ASYNC": mode})
    assert len(said) == 3
    assert all(words.startswith("DeviceFault: ") for words in said)


def test_a_fault_of_the_kernel_itself_is_one_of_the_device(posed):
    problem, params, *_ = posed
    with pytest.raises(Failed, match=r"^DeviceFault: the GPU failed with CUDA error 700 \(illegal address\)"):
        run(device_work.out_of_bounds, problem=problem, params=params)


def test_an_error_that_passes_costs_one_solve(posed):
    problem, params, first, _ = posed
    said, u = run(device_work.after_an_error, problem=problem, params=params, code=OUT_OF_RESOURCES)
    assert said.startswith("LaunchError: cuLaunchKernel failed: too many resources")
    assert u.tobytes() == first.u.tobytes()


def test_without_memory_on_the_device_the_cpu_computes_and_the_next_solve_is_the_devices(posed):
    """Whichever allocation it is that fails; and nothing is left on the device."""
    problem, params, first, native = posed
    allocations = first.host.allocations
    outcomes = run(device_work.short_of_memory, problem=problem, params=params, allocations=allocations)
    assert len(outcomes) == allocations > 10
    for without, again, kept in outcomes:
        assert (without.by, without.warnings, dict(without.copies)) == (
            "native",
            ("device-out-of-memory",),
            {},
        )
        assert without.u.tobytes() == native.tobytes()
        assert (again.by, again.warnings) == ("cuda", ())
        assert again.u.tobytes() == first.u.tobytes()
        assert kept == 0


def test_a_launch_without_memory_is_left_to_the_cpu(posed):
    problem, params, _, native = posed
    found = run(
        device_work.solved_globally, problems=[(problem, params)], env={"FAKE_CUDA_FAIL_LAUNCH": "2:2"}
    )
    assert found[0].by == "native"
    assert found[0].u.tobytes() == native.tobytes()


def test_buffers_of_another_size_make_room():
    """Each of the two fits into 1 MiB alone."""
    problems = [problem_of("released", width, 120, levels=1, warps=1) for width in (140, 141)]
    found = run(device_work.solved_globally, problems=problems * 2, env={"FAKE_CUDA_MEMORY": "1"})
    assert [solved.by for solved in found] == ["cuda"] * 4
    roomy = run(device_work.solved_globally, problems=problems)
    assert [solved.u.tobytes() for solved in found] == [solved.u.tobytes() for solved in roomy] * 2


def test_a_picture_that_never_fits_is_the_cpus(posed):
    problem, params = problem_of("released", 300, 200, levels=1, warps=1)
    found = run(device_work.solved_globally, problems=[(problem, params)] * 2, env={"FAKE_CUDA_MEMORY": "1"})
    assert [(solved.by, solved.warnings) for solved in found] == [("native", ("device-out-of-memory",))] * 2


def test_copies_are_timed_on_the_device_where_it_computed(posed):
    problem, params, *_ = posed
    (solved,) = run(device_work.solved_globally, problems=[(problem, params)])
    assert set(solved.copies) == {"h2d", "d2h"}
    assert all(0 < milliseconds < 1000 for milliseconds in solved.copies.values())
    assert NATIVE.globally(problem, params).copies == {}


def test_a_result_says_what_computed_it_and_why(posed):
    rng = np.random.default_rng(3)
    image = rng.integers(0, 255, (30, 40), np.uint8)
    pair = [image, image, np.full((30, 40), 2, np.float32)]
    brief = {"preset": "released", "gdr": {"warps": 1, "levels": 1}}
    found = run(
        device_work.refined, pair=pair, params=brief, backend="cuda", env={"FAKE_CUDA_FAIL_ALLOCATION": "0"}
    )
    assert found.meta["backend"] == "native"
    assert "device" not in found.meta
    assert "device-out-of-memory" in found.quality["warnings"]
