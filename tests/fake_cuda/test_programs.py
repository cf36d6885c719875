"""Real kernels through real PyCUDA give what NumPy gives, in every order of threads."""

import numpy as np
import programs
import pytest
from fakecuda import ptx_of, run
from programs import launch

ORDERS = ["forward", "reverse", "shuffled:7"]
rng = np.random.default_rng(3)


@pytest.fixture(params=ORDERS)
def order(request):
    return request.param


def floats(*shape):
    return rng.uniform(-9, 9, shape).astype(np.float32)


def integers(low, high, *shape):
    return rng.integers(low, high, shape).astype(np.int32)


def relaxed(image, steps):
    for _ in range(steps):
        padded = np.pad(image, 1, mode="edge")
        beside = padded[1:-1, :-2] + padded[1:-1, 2:]
        across = padded[:-2, 1:-1] + padded[2:, 1:-1]
        image = 0.5 * image + 0.125 * (beside + across)
    return image


def test_saxpy_is_numpys_with_one_rounding(order):
    x, y = floats(1001), floats(1001)
    a = np.float32(2.7)
    got = run(
        launch,
        order=order,
        file="basics",
        kernel="saxpy",
        args=[a, x, y, np.int32(1001)],
        grid=(8,),
        block=(128,),
    )
    exact = (np.float64(a) * x + y).astype(np.float32)
    np.testing.assert_array_equal(got.arrays[1], exact)


def test_saxpy_is_counted_as_by_hand():
    x, y = floats(1000), floats(1000)
    args = [np.float32(2), x, y, np.int32(1000)]
    counters = run(launch, file="basics", kernel="saxpy", args=args, grid=(8,), block=(128,)).counters
    assert counters.launches == 1
    assert counters.global_read == 1000 * 8
    assert counters.global_written == 1000 * 4
    assert counters.flops == 1000 * 2
    assert (counters.shared_read, counters.shared_written, counters.barriers) == (0, 0, 0)


def test_the_stencil_is_counted_as_by_hand():
    image = floats(8, 8)
    args = [image, np.zeros_like(image), *(np.int32(n) for n in (8, 8, 1))]
    counters = run(launch, file="stencil", kernel="relax_right", args=args, block=(12, 12)).counters
    assert counters.global_read == counters.global_written == 64 * 4
    assert counters.shared_written == (64 + 64) * 4  # the load and one step
    assert counters.barriers == 2
    assert counters.flops == 64 * (3 + 1 + 2)  # three sums, a product, a fused multiply-add


@pytest.mark.parametrize("steps", [0, 1, 2])
@pytest.mark.parametrize("shape", [(1, 1), (8, 8), (23, 37)])
def test_steps_in_shared_memory_are_steps_of_the_whole_image(order, shape, steps):
    image = floats(*shape)
    height, width = shape
    args = [image, np.zeros_like(image), *(np.int32(n) for n in (width, height, steps))]
    grid = (-(-width // 8), -(-height // 8))
    got = run(launch, order=order, file="stencil", kernel="relax_right", args=args, grid=grid, block=(12, 12))
    np.testing.assert_allclose(got.arrays[1], relaxed(image.astype(np.float64), steps), rtol=0, atol=4e-6)
    assert got.host.unwritten_bytes_to_host == 0


@pytest.mark.parametrize("arch", ["sm_75", "sm_90", "sm_120"])
def test_what_the_compiler_makes_for_other_devices(arch):
    image = floats(23, 37)
    args = [image, np.zeros_like(image), *(np.int32(n) for n in (37, 23, 2))]
    shape = {"grid": (5, 3), "block": (12, 12), "arch": arch, "env": {"FAKE_CUDA_ARCH": "120"}}
    got = run(launch, file="stencil", kernel="relax_right", args=args, **shape)
    np.testing.assert_allclose(got.arrays[1], relaxed(image.astype(np.float64), 2), rtol=0, atol=4e-6)


@pytest.mark.parametrize("arch", ["sm_75", "sm_90", "sm_120"])
@pytest.mark.parametrize("file", ["stencil", "numbers", "broken"])
def test_modules_for_other_devices_are_understood(arch, file):
    text = ptx_of(programs.KERNELS / f"{file}.cu", arch=arch).read_text()
    run(programs.load, ptx=text, env={"FAKE_CUDA_ARCH": "120"})


@pytest.mark.parametrize("option", ["-G", "-lineinfo", "-use_fast_math"])
@pytest.mark.parametrize("file", ["basics", "numbers"])
def test_modules_compiled_with_options_are_understood(option, file):
    run(programs.load, ptx=ptx_of(programs.KERNELS / f"{file}.cu", option).read_text())


def test_sums_with_shuffles_and_atomics(order):
    x = integers(-50, 50, 3000).astype(np.float32)
    args = [x, np.zeros(1, np.float32), np.int32(3000)]
    got = run(launch, order=order, file="basics", kernel="sum", args=args, grid=(12,), block=(256,))
    assert got.arrays[1][0] == x.sum()


def test_a_fence_and_an_atomic_order_blocks(order):
    x = integers(-50, 50, 20).astype(np.float32)
    args = [x, np.zeros(20, np.float32), np.zeros(1, np.int32), np.zeros(1, np.float32)]
    got = run(
        launch, order=order, file="basics", kernel="sum_by_last_block", args=args, grid=(20,), block=(32,)
    )
    assert got.arrays[3][0] == x.sum()


def test_histogram_in_shared_memory(order):
    x = rng.integers(0, 256, 5000).astype(np.uint8)
    args = [x, np.zeros(256, np.int32), np.int32(5000)]
    got = run(launch, order=order, file="basics", kernel="histogram", args=args, grid=(20,), block=(256,))
    np.testing.assert_array_equal(got.arrays[1], np.bincount(x, minlength=256))


def test_atomics(order):
    x = integers(0, 1000, 64)
    start = np.array([-5, 2000, 0, 0, -1, 0, 3, 0], np.int32)
    got = run(launch, order=order, file="basics", kernel="atomics", args=[x, start], grid=(2,), block=(32,))
    ored, xored, anded = (np.bitwise_or.reduce(x), np.bitwise_xor.reduce(x), np.bitwise_and.reduce(x))
    expected = [x.max(), x.min(), ored, xored, anded, 17, 4, 64 % 10]
    np.testing.assert_array_equal(got.arrays[1], expected)


def test_votes_matches_and_shuffles(order):
    x = integers(0, 8, 32)
    got = run(
        launch, order=order, file="basics", kernel="votes", args=[x, np.zeros(224, np.uint32)], block=(32,)
    )
    ballot, any_all, match, total, active, shuffled, indexed = got.arrays[1].reshape(7, 32)
    lanes = np.arange(32)
    bits = np.uint32(1) << lanes.astype(np.uint32)
    assert set(ballot) == {bits[x > 3].sum()}
    assert set(any_all) == {2}
    np.testing.assert_array_equal(match, [bits[x == value].sum() for value in x])
    assert set(total) == {x.sum()}
    np.testing.assert_array_equal(active, np.where(lanes % 2, bits[1::2].sum(), 0))
    up = np.where(lanes < 3, x, x[lanes - 3])
    np.testing.assert_array_equal(shuffled, up + 1000 * x[lanes ^ 5])
    np.testing.assert_array_equal(indexed, x[(lanes + 1) % 16 + lanes // 16 * 16])


def test_barriers_that_count(order):
    x = integers(0, 8, 96)
    got = run(
        launch,
        order=order,
        file="basics",
        kernel="counted_barriers",
        args=[x, np.zeros(96, np.int32)],
        block=(96,),
    )
    assert set(got.arrays[1]) == {(x > 3).sum() + 1000}


def test_threads_that_part_ways_meet_again(order):
    x = integers(1, 1000, 256)
    args = [x, np.zeros(256, np.int32), np.zeros(256, np.int32)]
    got = run(launch, order=order, file="basics", kernel="divergent", args=args, grid=(2,), block=(128,))
    steps = np.array([collatz(int(v)) for v in x])
    cases = [steps * 3, steps - 7, steps ^ 21, steps << 2, steps // 3, -steps, steps & 5, steps % 5]
    np.testing.assert_array_equal(got.arrays[1], steps)
    np.testing.assert_array_equal(got.arrays[2], np.choose(x % 8, cases))


def collatz(value):
    steps = 0
    while value != 1:
        value = 3 * value + 1 if value % 2 else value // 2
        steps += 1
    return steps


def test_four_floats_at_once(order):
    x = floats(64, 4)
    args = [x, np.zeros_like(x), np.float32(1.3)]
    got = run(launch, order=order, file="basics", kernel="scale_fours", args=args, grid=(2,), block=(32,))
    a = np.float32(1.3)
    expected = np.stack([a * x[:, 0], x[:, 1] - a, x[:, 2] / a, x[:, 3] + a], axis=1)
    np.testing.assert_array_equal(got.arrays[1], expected)
    assert got.counters.global_read == got.counters.global_written == x.nbytes


def test_doubles():
    x, y = rng.normal(size=100), rng.normal(size=100)
    args = [np.float64(1.7), x, y, np.int32(100)]
    got = run(launch, file="basics", kernel="axpy64", args=args, grid=(4,), block=(32,))
    np.testing.assert_allclose(got.arrays[1], 1.7 * x + np.sqrt(np.abs(y)) / 3, rtol=1e-15, atol=1e-16)


def test_structures_and_calls(order):
    pair = np.array([(0.5, 3, 0.25)], [("scale", "f4"), ("shift", "i4"), ("offset", "f8")])[0]
    args = [pair, np.zeros(8, np.float32)]
    got = run(launch, order=order, file="basics", kernel="struct_and_call", args=args, block=(8,))
    i = np.arange(8)
    np.testing.assert_array_equal(got.arrays[0], 0.75 * 2.0**i + 3 + i + 2.0 ** (i & 3))


def test_variables_of_the_module():
    total, out = run(programs.variables)
    assert total == 7
    np.testing.assert_array_equal(out, np.arange(8) + np.arange(8) % 4)


def test_local_arrays(order):
    x = integers(0, 100, 32)
    got = run(
        launch,
        order=order,
        file="basics",
        kernel="local_array",
        args=[x, np.zeros(32, np.float32)],
        block=(32,),
    )
    np.testing.assert_array_equal(got.arrays[1], x[x & 7] * 0.5)


@pytest.mark.parametrize("threads", [1, 31, 100, 1024])
def test_dynamic_shared_memory(order, threads):
    x = floats(threads)
    got = run(
        launch, order=order, file="basics", kernel="mirror", args=[x], block=(threads,), shared=4 * threads
    )
    np.testing.assert_array_equal(got.arrays[0], x[::-1])


def test_neighbours_in_a_warp(order):
    x = floats(64)
    got = run(launch, order=order, file="basics", kernel="swap_in_warp", args=[x], block=(64,))
    np.testing.assert_array_equal(got.arrays[0], x.reshape(32, 2)[:, ::-1].ravel())


def test_bytes_of_one_word_belong_to_different_threads_and_blocks(order):
    x = rng.integers(0, 256, 1000).astype(np.uint8)
    got = run(
        launch,
        order=order,
        file="basics",
        kernel="invert_bytes",
        args=[x, np.int32(1000)],
        grid=(101,),
        block=(10,),
    )
    np.testing.assert_array_equal(got.arrays[0], 255 - x)


def test_memory_management():
    got = run(programs.memory_management)
    np.testing.assert_array_equal(got["row"], np.arange(21, 28))
    assert set(got["filled"]) == {7}
    assert got["elapsed"] >= 0
    assert got["freed"] == 64
