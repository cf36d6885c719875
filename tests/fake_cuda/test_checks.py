"""Each check finds the fault that was planted for it, in every order of threads."""

import numpy as np
import programs
import pytest
from fakecuda import Failed, run
from programs import Unwritten, launch

ORDERS = ["forward", "reverse", "shuffled:7"]


@pytest.fixture(params=ORDERS)
def order(request):
    return request.param


def ones(count):
    return np.ones(count, np.float32)


def relax(kernel, order, width=20, height=20):
    image = np.random.default_rng(1).random((height, width)).astype(np.float32)
    args = [image, np.zeros_like(image), *(np.int32(n) for n in (width, height, 2))]
    grid = (-(-width // 8), -(-height // 8))
    return run(launch, order=order, file="stencil", kernel=kernel, args=args, grid=grid, block=(12, 12))


def broken(kernel, args, order, grid=(1,), block=(32,), **more):
    return run(launch, order=order, file="broken", kernel=kernel, args=args, grid=grid, block=block, **more)


STENCIL_FAULTS = {
    "relax_no_barrier_after_load": "race within the block|never written",
    "relax_no_barrier_between_steps": "race within the block|never written",
    "relax_guard_off_by_one": "out of bounds: global|race between blocks: global",
    "relax_halo_one_short": "never written: shared read",
    "relax_shared_one_short": "out of bounds: shared write of 4 bytes at byte 1148 of .*, which has 1148",
    "relax_early_return": r"divergent barrier: \d+ of 144 threads wait .* have left",
    "relax_barrier_in_branch": r"divergent barrier: \d+ of 144 threads wait",
    "relax_in_place_shared": "race within the block: shared",
}


@pytest.mark.parametrize("kernel", STENCIL_FAULTS)
def test_a_fault_in_the_stencil_is_found(kernel, order):
    with pytest.raises(Failed, match=STENCIL_FAULTS[kernel]):
        relax(kernel, order)


def test_the_stencil_without_fault_passes(order):
    relax("relax_right", order)


def test_the_last_pixel_alone_gives_a_guard_away(order):
    with pytest.raises(Failed, match="0 bytes past the end of an allocation of 256 bytes"):
        broken("beyond_the_end", [ones(64), np.int32(64)], order, grid=(2,), block=(64,))


def test_reading_before_the_start_is_out_of_bounds(order):
    with pytest.raises(Failed, match=r"4 bytes before an allocation|bytes past the end"):
        broken("before_the_start", [ones(64), ones(64), np.int32(64)], order, grid=(2,))


def test_a_message_names_kernel_block_thread_and_line():
    with pytest.raises(
        Failed, match=r"kernel beyond_the_end, block \(1,0,0\), thread \(0,0,0\), PTX line \d+: st\.global"
    ):
        broken("beyond_the_end", [ones(64), np.int32(64)], "forward", grid=(2,), block=(64,))


def test_results_of_a_stencil_on_its_own_input_are_a_race_between_blocks(order):
    image = np.random.default_rng(1).random((16, 16)).astype(np.float32)
    with pytest.raises(Failed, match="race between blocks: global"):
        run(programs.in_place, order=order, kernel="relax_right", image=image, steps=1)


def test_one_block_may_work_in_place_where_two_may_not(order):
    x = np.random.default_rng(1).random(64).astype(np.float32)
    broken("smooth_in_place", [x, np.int32(64)], order, grid=(1,), block=(64,))
    with pytest.raises(Failed, match="race between blocks"):
        broken("smooth_in_place", [x, np.int32(64)], order, grid=(2,), block=(32,))


def test_a_sum_without_atomics_is_a_race(order):
    count = np.zeros(1, np.int32)
    with pytest.raises(Failed, match="race within the block: global"):
        broken("counts_without_atomics", [count], order, block=(2,))
    with pytest.raises(Failed, match="race between blocks: global"):
        broken("counts_without_atomics", [count], order, grid=(2,), block=(1,))


def test_races_can_be_left_to_their_results():
    got = broken(
        "counts_without_atomics",
        [np.zeros(1, np.int32)],
        "forward",
        grid=(2,),
        env={"FAKE_CUDA_RACES": "off"},
    )
    assert got.arrays[0][0] == 2


def test_warps_do_not_synchronise_by_themselves(order):
    with pytest.raises(Failed, match="race within the block: shared read"):
        broken("no_warp_barrier", [ones(32)], order)


def test_global_memory_that_nobody_wrote(order):
    with pytest.raises(Failed, match="never written: global read"):
        broken("copy", [Unwritten(256), ones(64), np.int32(64)], order, block=(64,))


def test_unwritten_results_are_counted():
    assert run(programs.half_written).unwritten_bytes_to_host == 32 * 4


def test_shared_memory_that_nobody_wrote(order):
    with pytest.raises(Failed, match="never written: shared read of 4 bytes at byte 128 of"):
        broken("reads_shared_too_early", [ones(32)], order)


def test_freed_memory_is_not_read():
    with pytest.raises(Failed, match="freed memory: global read"):
        run(programs.freed_memory)


def test_a_float4_that_is_not_aligned():
    with pytest.raises(Failed, match="misaligned: global read of 16 bytes"):
        broken("misaligned", [ones(132), ones(128)], "forward")


def test_a_shuffle_from_a_lane_that_does_not_exist(order):
    with pytest.raises(Failed, match="takes no part"):
        broken("shuffles", [ones(24)], order, block=(24,))
    broken("shuffles", [ones(32)], order, block=(32,))


def test_threads_at_different_barriers(order):
    with pytest.raises(Failed, match=r"divergent barrier: (64|32) of 64 threads wait"):
        broken("different_barriers", [ones(64)], order, block=(64,))


def test_local_arrays_have_an_end():
    with pytest.raises(Failed, match="out of bounds: local read"):
        broken("local_beyond_the_end", [np.full(32, 8, np.int32), ones(32)], "forward")


def test_kernels_end():
    with pytest.raises(Failed, match="does not end"):
        broken("never_ends", [np.zeros(1, np.int32)], "forward", env={"FAKE_CUDA_MAX_STEPS": "100000"})


def test_traps_are_reported():
    broken("traps", [np.int32(3)], "forward")
    with pytest.raises(Failed, match="trap"):
        broken("traps", [np.int32(4)], "forward")


def test_orders_differ_where_the_result_depends_on_them():
    last = {o: broken("order_dependent", [np.zeros(1, np.int32)], o, grid=(4,)).arrays[0][0] for o in ORDERS}
    assert last["forward"] == 127
    assert last["reverse"] == 0
    assert last["shuffled:7"] not in (0, 127)


WRONG_CALLS = {
    "one too few": ("fPP", [1.0, "x", "y"]),
    "one too many": ("fPPii", [1.0, "x", "y", 4, 4]),
    "a long for an int": ("fPPq", [1.0, "x", "y", 4]),
    "a float for a pointer": ("ffPi", [1.0, 1.0, "y", 4]),
}


@pytest.mark.parametrize("wrong", WRONG_CALLS)
def test_arguments_of_another_size_are_refused(wrong):
    types, values = WRONG_CALLS[wrong]
    with pytest.raises(Failed, match="saxpy takes 4 arguments of 28 bytes, not"):
        run(programs.prepared, types=types, values=values)


def test_arguments_of_the_right_size_are_accepted():
    run(programs.prepared, types="fPPi", values=[1.0, "x", "y", 4])


def test_more_shared_memory_than_there_is():
    with pytest.raises(Failed, match="more shared memory than allowed"):
        run(launch, file="basics", kernel="mirror", args=[ones(32)], block=(32,), shared=49153)


def test_more_threads_than_there_are():
    with pytest.raises(Failed, match="beyond the limits"):
        run(launch, file="basics", kernel="mirror", args=[ones(32)], block=(1025,), shared=4)
