"""What the tests run on the fake device, each function in a process of its own: ordinary PyCUDA."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from fakecuda import Counters, FakeDevice, HostCounters, ptx_of

KERNELS = Path(__file__).parent / "kernels"


@dataclass
class Unwritten:
    """An argument: device memory that nobody wrote."""

    bytes: int


@dataclass
class Outcome:
    """Arrays as the kernel left them, in the order of the arguments, and what was counted."""

    arrays: list[np.ndarray]
    counters: Counters
    host: HostCounters


@contextmanager
def module(name: str, arch: str = "sm_80") -> Iterator[Any]:
    import pycuda.driver as cuda

    cuda.init()
    context = cuda.Device(0).make_context()
    try:
        yield cuda.module_from_buffer(ptx_of(KERNELS / f"{name}.cu", arch=arch).read_bytes())
    finally:
        context.pop()


def launch(
    file: str,
    kernel: str,
    args: Sequence[Any],
    grid: tuple[int, ...] = (1,),
    block: tuple[int, ...] = (1,),
    shared: int = 0,
    arch: str = "sm_80",
) -> Outcome:
    """One launch. Arrays are copied to the device and back."""
    import pycuda.driver as cuda

    with module(file, arch) as loaded:
        function = loaded.get_function(kernel)
        on_device = [placed(arg) for arg in args]
        function(*on_device, grid=grid, block=(*block, 1, 1)[:3], shared=shared)
        cuda.Context.synchronize()
        arrays = [
            cuda.from_device(there, here.shape, here.dtype)
            for here, there in zip(args, on_device, strict=True)
            if isinstance(here, np.ndarray)
        ]
        device = FakeDevice()
        return Outcome(arrays, device.counters(kernel), device.host())


def placed(arg: Any) -> Any:
    import pycuda.driver as cuda

    if isinstance(arg, np.ndarray):
        return cuda.to_device(arg)
    return cuda.mem_alloc(arg.bytes) if isinstance(arg, Unwritten) else arg


def in_place(kernel: str, image: np.ndarray, steps: int) -> np.ndarray:
    """The stencil with its output on top of its input."""
    import pycuda.driver as cuda

    height, width = image.shape
    with module("stencil") as loaded:
        there = cuda.to_device(image)
        numbers = [np.int32(n) for n in (width, height, steps)]
        grid = (-(-width // 8), -(-height // 8))
        loaded.get_function(kernel)(there, there, *numbers, grid=grid, block=(12, 12, 1))
        return np.asarray(cuda.from_device(there, image.shape, image.dtype))


def half_written() -> HostCounters:
    """Copies 64 floats to the host of which a kernel wrote the first 32."""
    import pycuda.driver as cuda

    with module("broken") as loaded:
        x, y = cuda.to_device(np.ones(64, np.float32)), cuda.mem_alloc(256)
        loaded.get_function("copy")(x, y, np.int32(32), grid=(1,), block=(64, 1, 1))
        cuda.from_device(y, 64, np.float32)
        return FakeDevice().host()


def freed_memory() -> None:
    import pycuda.driver as cuda

    with module("broken") as loaded:
        x = cuda.to_device(np.ones(32, np.float32))
        address = np.uintp(int(x))
        y = cuda.to_device(np.ones(32, np.float32))
        x.free()
        loaded.get_function("copy")(address, y, np.int32(32), grid=(1,), block=(32, 1, 1))


def prepared(types: str, values: list[Any]) -> None:
    """saxpy of four numbers, called through a format of its arguments that the test chooses."""
    import pycuda.driver as cuda

    with module("basics") as loaded:
        x, y = (cuda.to_device(np.ones(4, np.float32)) for _ in range(2))
        arrays = {"x": x, "y": y}
        values = [arrays[value] if isinstance(value, str) else value for value in values]
        loaded.get_function("saxpy").prepare(types).prepared_call((1,), (32, 1, 1), *values)


def pipeline(pinned: bool, waits: bool) -> tuple[np.ndarray, HostCounters]:
    """Copies in, computes and copies out on one stream; reads the result with or without waiting for it."""
    import pycuda.driver as cuda

    with module("basics") as loaded:
        make = cuda.pagelocked_empty if pinned else np.empty
        x, y = (make(256, np.float32) for _ in range(2))
        x[:] = np.arange(256)
        y[:] = 1.0
        stream = cuda.Stream()
        there = [cuda.mem_alloc(a.nbytes) for a in (x, y)]
        device = FakeDevice()
        device.reset_counters()
        for to, a in zip(there, (x, y), strict=True):
            cuda.memcpy_htod_async(to, a, stream)
        saxpy = loaded.get_function("saxpy")
        saxpy(np.float32(2), *there, np.int32(256), grid=(2,), block=(128, 1, 1), stream=stream)
        cuda.memcpy_dtoh_async(y, there[1], stream)
        if waits:
            stream.synchronize()
        return np.array(y), device.host()


def planned_faults() -> list[str]:
    """What PyCUDA says while the device is out of memory, breaks down, stays so, and is repaired."""
    import pycuda.driver as cuda

    said = []

    def attempt(action: Any) -> None:
        try:
            action()
            said.append("fine")
        except cuda.Error as error:
            said.append(f"{type(error).__name__}: {error}")

    device = FakeDevice()
    with module("basics") as loaded:
        y = cuda.to_device(np.ones(32, np.float32))

        def saxpy() -> None:
            loaded.get_function("saxpy")(np.float32(1), y, y, np.int32(32), grid=(1,), block=(32, 1, 1))

        device.fail_allocation()
        attempt(lambda: cuda.mem_alloc(4))
        attempt(lambda: cuda.mem_alloc(4))
        device.fail_launch(after=1, code=700)
        for action in (saxpy, saxpy, saxpy, cuda.Context.synchronize, lambda: cuda.mem_alloc(4)):
            attempt(action)
        device.repair()
        attempt(saxpy)
    return said


def initialise() -> int:
    import pycuda.driver as cuda

    cuda.init()
    return int(cuda.Device.count())


def device_facts() -> dict[str, Any]:
    import pycuda.driver as cuda

    with module("stencil") as loaded:
        device = cuda.Context.get_device()
        function = loaded.get_function("relax_right")
        return {
            "capability": device.compute_capability(),
            "memory": device.total_memory(),
            "threads": device.get_attribute(cuda.device_attribute.MAX_THREADS_PER_BLOCK),
            "shared": function.shared_size_bytes,
        }


def load(ptx: str) -> None:
    """Loads a module from its text."""
    import pycuda.driver as cuda

    cuda.init()
    context = cuda.Device(0).make_context()
    try:
        cuda.module_from_buffer(ptx.encode())
    finally:
        context.pop()


def variables() -> tuple[int, np.ndarray]:
    """A device variable before and after a kernel adds to it, and a changed constant."""
    import pycuda.driver as cuda

    with module("basics") as loaded:
        table, size = loaded.get_global("table")
        cuda.memcpy_htod(table, np.arange(size // 4, dtype=np.float32))
        out = cuda.to_device(np.zeros(8, np.float32))
        pair = np.zeros(1, [("scale", "f4"), ("shift", "i4"), ("offset", "f8")])[0]
        loaded.get_function("struct_and_call")(pair, out, grid=(1,), block=(8, 1, 1))
        total = cuda.from_device(loaded.get_global("total")[0], 1, np.int32)
        return int(total[0]), np.asarray(cuda.from_device(out, 8, np.float32))


def memory_management() -> dict[str, Any]:
    """Pitched rows, fills, copies between allocations, events."""
    import pycuda.driver as cuda

    cuda.init()
    context = cuda.Device(0).make_context()
    try:
        image = np.arange(35, dtype=np.float32).reshape(5, 7)
        there, pitch = cuda.mem_alloc_pitch(7 * 4, 5, 4)
        copy = cuda.Memcpy2D()
        copy.set_src_host(image)
        copy.set_dst_device(there)
        copy.src_pitch, copy.dst_pitch, copy.width_in_bytes, copy.height = 28, pitch, 28, 5
        copy(aligned=True)
        row = np.empty(7, np.float32)
        cuda.memcpy_dtoh(row, int(there) + 3 * pitch)
        first, second = (cuda.mem_alloc(64) for _ in range(2))
        cuda.memset_d32(first, 7, 16)
        cuda.memcpy_dtod(second, first, 64)
        start, end = cuda.Event(), cuda.Event()
        start.record()
        end.record()
        end.synchronize()
        free_before = cuda.mem_get_info()[0]
        first.free()
        freed = cuda.mem_get_info()[0] - free_before
        filled = cuda.from_device(second, 16, np.int32)
        return {"row": row, "filled": filled, "elapsed": end.time_since(start), "freed": freed}
    finally:
        context.pop()


SNIPPET = """.version 8.0
.target sm_80
.address_size 64
.visible .entry snippet(.param .u64 in, .param .u64 out)
{{
.reg .b16 %h<9>; .reg .b32 %r<9>; .reg .f32 %f<9>; .reg .b64 %d<9>; .reg .f64 %g<9>; .reg .pred %p<9>;
ld.param.u64 %d7, [in];
ld.param.u64 %d8, [out];
mov.u32 %r7, %tid.x;
mul.wide.u32 %d6, %r7, 16;
add.s64 %d7, %d7, %d6;
add.s64 %d8, %d8, %d6;
ld.global.v4.b32 {{%r1, %r2, %r3, %r4}}, [%d7];
mov.b32 %r5, 0;
mov.b64 %d1, {{%r1, %r2}};
mov.b64 %d2, {{%r3, %r4}};
mov.b64 %d3, 0;
{body}
mov.b64 {{%r6, %r8}}, %d3;
st.global.v4.b32 [%d8], {{%r5, %r6, %r8, %r5}};
ret;
}}
"""


def snippet(body: str, inputs: np.ndarray) -> np.ndarray:
    """Lines of PTX on four 32-bit integers a thread, %r1 to %r4, also %d1 and %d2; results %r5 and %d3."""
    import pycuda.driver as cuda

    cuda.init()
    context = cuda.Device(0).make_context()
    try:
        function = cuda.module_from_buffer(SNIPPET.format(body=body).encode()).get_function("snippet")
        there, out = cuda.to_device(inputs), cuda.mem_alloc(inputs.nbytes)
        function(there, out, grid=(1,), block=(len(inputs), 1, 1))
        return np.asarray(cuda.from_device(out, inputs.shape, inputs.dtype))
    finally:
        context.pop()
