"""The global stage on a CUDA device through PyCUDA; everything else on the CPU.

PyCUDA is imported when a backend is made, nowhere else: a machine without CUDA loses nothing.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereomend.errors import BackendUnavailable
from stereomend.refinement.backends import cuda_plan as plan
from stereomend.refinement.backends.cuda_compile import Sources, compile_kernels
from stereomend.refinement.backends.cuda_faults import check_alive
from stereomend.refinement.backends.cuda_solver import ARGUMENTS, Inputs, Solver
from stereomend.refinement.backends.data import COPIES, UNGUIDED, Guide, Plane, Problem, Solved, Tick
from stereomend.refinement.backends.native import NativeBackend
from stereomend.refinement.stage_params import GdrParams

OUT_OF_MEMORY = "device-out-of-memory"
"""The warning in a result that the CPU computed as the device had no room for it."""

log = logging.getLogger(__name__)


class CudaBackend(NativeBackend):
    """Implements `Backend`: LDR and fusion are the CPU's, as `native` does them, GDR is the device's.

    One call at a time reaches the device; others wait. A picture too long for a launch is left to the CPU,
    and so is one that the device has no memory for. After DeviceFault neither this nor its process is of use.

    Raises:
        BackendUnavailable: package, driver, device or compiler are missing; the message says which.
    """

    name = "cuda"

    def __init__(self, threads: int, reason: str, sources: Sources | None = None) -> None:
        super().__init__(threads, reason)
        sources = Sources.installed() if sources is None else sources
        self._cpu = NativeBackend(threads, reason, self._engine)
        self._gpu = PyCudaDevice(sources)
        self.reason = f"{reason} ({self._gpu.label})"
        self.kernel = f"{sources.digest()[:12]}+{NativeBackend.kernel}"
        self._solver = Solver(self._gpu)

    def solve(  # noqa: PLR0913 - as `Backend.solve`
        self,
        left: Plane,
        right: Plane,
        u: Plane,
        params: GdrParams,
        *,
        weight: Plane | None = None,
        guide: Guide = UNGUIDED,
        tick: Tick | None = None,
    ) -> Plane:
        """See `Backend.solve`."""
        inputs = Inputs(left, right, u, weight, (), *guide)
        solved = self._solve(inputs, params.model_copy(update={"levels": 1}))
        if isinstance(solved, Left):
            return self._cpu.solve(left, right, u, params, weight=weight, guide=guide, tick=tick)
        return solved.u

    def globally(self, problem: Problem, params: GdrParams, tick: Tick | None = None) -> Solved:
        """See `Backend.globally`."""
        inputs = Inputs(
            problem.left,
            problem.right,
            problem.prior,
            problem.weight,
            problem.channels if params.edge_level is not None and params.levels > 1 else (),
            problem.edge,
            None if problem.trust is None else problem.prior,
            problem.trust,
        )
        solved = self._solve(inputs, params)
        if isinstance(solved, Left):
            return self._cpu.globally(problem, params, tick)._replace(warnings=solved.warnings)
        return solved

    def _solve(self, inputs: Inputs, params: GdrParams) -> Solved | Left:
        if max(inputs.left.shape) > plan.LONGEST_SIDE:
            return Left()
        with self._gpu.current():
            kept = self._solver.keeps
            solved = self._attempt(inputs, params)
            # Other sizes may have had the room that was missing.
            if solved is None and kept:
                solved = self._attempt(inputs, params)
        if solved is None:
            log.warning("the device has no memory for %d x %d pixels", *inputs.left.shape[::-1])
            return Left((OUT_OF_MEMORY,))
        return solved

    def _attempt(self, inputs: Inputs, params: GdrParams) -> Solved | None:
        """None if the device has no memory for it, and then nothing is left there."""
        try:
            u, copies = self._solver.solve(inputs, params)
            return Solved(u, self.name, copies, device=self._gpu.name)
        except self._gpu.OutOfMemory:
            pass  # while the error lives, its traceback keeps the buffers
        self._solver.give_back()
        return None


class Left(NamedTuple):
    """A solve is left to the CPU."""

    warnings: tuple[str, ...] = ()


class PyCudaDevice:
    """The first device, with a context of its own; implements `Device`. Raises BackendUnavailable."""

    def __init__(self, sources: Sources) -> None:
        self._driver = driver = _import_driver()
        self.OutOfMemory: type[Exception] = driver.MemoryError
        device = _first_device(driver)
        major, minor = device.compute_capability()
        speaks = driver.get_driver_version()
        compiled = compile_kernels(sources, 10 * major + minor, (speaks // 1000, speaks % 1000 // 10))
        self.name: str = device.name()
        self.label = f"{self.name}, compute {major}.{minor}, {compiled.by}"
        self._lock = RLock()
        try:
            self._context = device.make_context()
        except driver.Error as error:
            raise BackendUnavailable(f"cuda: no context on {self.label}: {_line(error)}") from error
        try:
            self._load(compiled.ptx)
        except driver.Error as error:
            raise BackendUnavailable(f"cuda: the kernels do not load: {_line(error)}") from error
        finally:
            self._context.pop()

    def _load(self, ptx: bytes) -> None:
        self._module = self._driver.module_from_buffer(ptx)
        self._stream = self._driver.Stream()
        self._events = {copy: (self._driver.Event(), self._driver.Event()) for copy in COPIES}
        self._kernels = {name: self._module.get_function(name) for name in ARGUMENTS}
        for name, kernel in self._kernels.items():
            kernel.prepare(ARGUMENTS[name])

    @contextmanager
    def current(self) -> Iterator[None]:
        """Make the context that of this thread for a while; others wait.

        After an exception nothing runs any more on the device (raises DeviceFault if it is lost).
        """
        with self._lock:
            self._context.push()
            try:
                yield
            except Exception as error:
                check_alive(_line(error))
                raise
            finally:
                self._context.pop()

    def allocate(self, floats: int) -> Any:
        """See `Device.allocate`."""
        return self._driver.mem_alloc(4 * floats)

    def pinned(self, shape: tuple[int, ...]) -> npt.NDArray[np.float32]:
        """See `Device.pinned`."""
        array: npt.NDArray[np.float32] = self._driver.pagelocked_empty(shape, np.float32)
        return array

    def upload(self, to: int, array: npt.NDArray[np.float32]) -> None:
        """See `Device.upload`."""
        self._driver.memcpy_htod_async(to, array, self._stream)

    def download(self, array: npt.NDArray[np.float32], source: int) -> None:
        """See `Device.download`."""
        self._driver.memcpy_dtoh_async(array, source, self._stream)

    @contextmanager
    def timed(self, copy: str) -> Iterator[None]:
        """See `Device.timed`."""
        begin, end = self._events[copy]
        begin.record(self._stream)
        yield
        end.record(self._stream)

    def milliseconds(self, copy: str) -> float:
        """See `Device.milliseconds`."""
        begin, end = self._events[copy]
        return float(begin.time_till(end))

    def launch(self, kernel: str, shape: plan.Shape, *arguments: float) -> None:
        """See `Device.launch`."""
        self._kernels[kernel].prepared_async_call(shape.grid, shape.block, self._stream, *arguments)

    def finish(self) -> None:
        """See `Device.finish`."""
        self._stream.synchronize()


def _import_driver() -> Any:
    try:
        from pycuda import driver
    except ModuleNotFoundError as error:
        raise BackendUnavailable(
            "cuda: the package pycuda is not installed (pip install '.[gpu]')"
        ) from error
    except ImportError as error:
        raise BackendUnavailable(f"cuda: no NVIDIA driver: {_line(error)}") from error
    return driver


def _first_device(driver: Any) -> Any:
    try:
        driver.init()
        if driver.Device.count():
            return driver.Device(0)
    except driver.Error as error:
        raise BackendUnavailable(f"cuda: no device: {_line(error)}") from error
    raise BackendUnavailable("cuda: no device: the driver lists none")


def _line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0]
