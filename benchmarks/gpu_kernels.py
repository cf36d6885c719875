"""What GDR takes on this machine's GPU: whole solves, copies, and each kernel by the device's own events.

    .venv/bin/python benchmarks/gpu_kernels.py [--size 360x288 640x512] [--preset released paper robust]

Ceilings are measured beside: copies within the device's memory, multiply-adds in registers, empty launches.
It needs a GPU, PyCUDA and `nvcc`.
"""

import argparse
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from pycuda import compiler, driver

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "cuda")]

from problems import NATIVE, problem_of  # noqa: E402

from stereomend.refinement.backends import cuda  # noqa: E402

REPEATS = 30
COPIED = 1 << 30
BLOCKS, THREADS, ROUNDS, CHAINS = 132 * 32, 256, 4096, 8
EMPTY = 200

CEILINGS = """
extern "C" __global__ void multiply_add(float* out, int rounds) {
    float v[CHAINS];
    for (int i = 0; i < CHAINS; ++i) v[i] = threadIdx.x + i;
    for (int round = 0; round < rounds; ++round)
        for (int i = 0; i < CHAINS; ++i) v[i] = fmaf(v[i], 0.999f, 0.5f);
    float sum = 0;
    for (int i = 0; i < CHAINS; ++i) sum += v[i];
    out[blockIdx.x * blockDim.x + threadIdx.x] = sum;
}
extern "C" __global__ void nothing() {}
"""

Spans = dict[str, list[float]]
"""Microseconds of each launch, by kernel."""


class Watched(cuda.PyCudaDevice):
    """Keeps two events per launch while it is watched."""

    events: list[tuple[str, Any, Any]] | None = None

    def launch(self, kernel: str, shape: Any, *arguments: float) -> None:
        """See `Device.launch`."""
        if self.events is None:
            super().launch(kernel, shape, *arguments)
            return
        begin, end = driver.Event(), driver.Event()
        begin.record(self._stream)
        super().launch(kernel, shape, *arguments)
        end.record(self._stream)
        self.events.append((kernel, begin, end))

    def watch(self, work: Callable[[], object]) -> Spans:
        """What each kernel takes while `work` runs."""
        self.events = events = []
        work()
        self.events = None
        found = defaultdict(list)
        with self.current():
            for kernel, begin, end in events:
                found[kernel].append(1e3 * begin.time_till(end))
        return found


def microseconds(work: Callable[[], object]) -> float:
    """Of the device, the median of seven."""
    begin, end = driver.Event(), driver.Event()
    times = []
    for _ in range(7):
        begin.record()
        work()
        end.record()
        end.synchronize()
        times.append(1e3 * begin.time_till(end))
    return median(times)


def ceilings() -> str:
    """What the device in the current context could do."""
    source = CEILINGS.replace("CHAINS", str(CHAINS))
    module = driver.module_from_buffer(compiler.compile(source, no_extern_c=True, target="ptx"))
    fused, nothing = module.get_function("multiply_add"), module.get_function("nothing")
    fused.prepare("Pi")
    nothing.prepare("")
    first, second = driver.mem_alloc(COPIED), driver.mem_alloc(COPIED)
    grid, block = (BLOCKS, 1), (THREADS, 1, 1)
    copy = microseconds(lambda: driver.memcpy_dtod_async(first, second, COPIED))
    compute = microseconds(lambda: fused.prepared_async_call(grid, block, None, first, ROUNDS))
    empty = microseconds(
        lambda: [nothing.prepared_async_call((1, 1), (32, 1, 1), None) for _ in range(EMPTY)]
    )
    operations = 2 * CHAINS * ROUNDS * THREADS * BLOCKS
    return (
        f"copy {2 * COPIED / copy / 1e3:.0f} GB/s read and written, "
        f"multiply-add {operations / compute / 1e6:.1f} Tflop/s, a launch each {empty / EMPTY:.1f} us"
    )


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Milliseconds, and what came of it."""
    begin = time.perf_counter()
    done = work()
    return 1e3 * (time.perf_counter() - begin), done


def report(backend: cuda.CudaBackend, preset: str, width: int, height: int) -> None:
    """Print what one preset takes at a working size."""
    problem, params = problem_of(preset, width, height)

    def solve() -> Any:
        return backend.globally(problem, params)

    solve()
    runs = [timed(solve) for _ in range(REPEATS)]
    walls = [wall for wall, _ in runs]
    up, down = (median(solved.copies[copy] for _, solved in runs) for copy in ("h2d", "d2h"))
    native = [timed(lambda: NATIVE.globally(problem, params).u) for _ in range(5)]
    cpu = median(wall for wall, _ in native)
    near = np.mean(np.abs(native[0][1] - runs[0][1].u) <= 0.01)
    print(
        f"\n{preset} at {width} x {height}: {median(walls):.2f} ms (least {min(walls):.2f}), of that h2d "
        f"{up:.2f}, d2h {down:.2f}; native {cpu:.1f} ms, {near:.5f} of its pixels within 0.01 px"
    )
    table([backend._gpu.watch(solve) for _ in range(5)])


def table(runs: list[Spans]) -> None:
    """Print the medians of several runs, the longest first."""
    totals = {name: median(sum(run[name]) for run in runs) / 1e3 for name in runs[0]}
    busy = sum(totals.values())
    for name, total in sorted(totals.items(), key=lambda item: -item[1]):
        count = len(runs[0][name])
        each = 1e3 * total / count
        print(f"  {name:16s}{count:6d} launches{total:9.3f} ms{each:9.1f} us each{total / busy:7.0%}")
    print(f"  {'all':16s}{sum(map(len, runs[0].values())):6d} launches{busy:9.3f} ms")


def main() -> None:
    """Measure what was asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", nargs="+", default=["360x288", "640x512"], help="working size")
    parser.add_argument("--preset", nargs="+", default=["released", "paper", "robust"])
    options = parser.parse_args()
    cuda.PyCudaDevice = Watched  # type: ignore[misc]
    backend = cuda.CudaBackend(2, "measured")
    print(backend.reason)
    with backend._gpu.current():
        print(ceilings())
    for size in options.size:
        for preset in options.preset:
            report(backend, preset, *map(int, size.split("x")))


if __name__ == "__main__":
    main()
