"""What the fake driver exports beyond CUDA. For processes that have it loaded as `libcuda.so.1`."""

import ctypes
from dataclasses import dataclass, fields

from fakecuda.build import driver_folder


@dataclass(frozen=True)
class Counters:
    """Sums over the launches of one kernel, in the order of `struct Counters`."""

    launches: int
    global_read: int  # bytes
    global_written: int
    shared_read: int
    shared_written: int
    flops: int  # a fused multiply-add is two
    barriers: int  # per block
    instructions: int  # per thread


@dataclass(frozen=True)
class HostCounters:
    """What the host asked for, in the order of `struct HostCounters`."""

    synchronisations: int  # calls that wait for the device
    allocations: int
    frees: int
    bytes_to_device: int
    bytes_to_host: int
    unwritten_bytes_to_host: int  # copied although no one ever wrote them


class FakeDevice:
    """The fake driver of this process.

    Loads it if it is not there yet: that must come before `import pycuda.driver`, unless LD_LIBRARY_PATH
    names its folder.
    """

    def __init__(self) -> None:
        path = driver_folder() / "libcuda.so.1"
        self._library = ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
        self._library.fake_cuda_message.restype = ctypes.c_char_p
        self._library.fake_cuda_fail_launch.argtypes = [ctypes.c_int64, ctypes.c_int]
        self._library.fake_cuda_fail_allocation.argtypes = [ctypes.c_int64]

    def message(self) -> str:
        """What the last error was about."""
        return str(self._library.fake_cuda_message().decode())

    def counters(self, kernel: str) -> Counters:
        """Sums since the last reset."""
        values = (ctypes.c_uint64 * len(fields(Counters)))()
        self._library.fake_cuda_counters(kernel.encode(), values)
        return Counters(*values)

    def host(self) -> HostCounters:
        """Sums since the last reset."""
        values = (ctypes.c_uint64 * len(fields(HostCounters)))()
        self._library.fake_cuda_host_counters(values)
        return HostCounters(*values)

    def kernels(self) -> list[str]:
        """Names of the kernels that ran since the last reset."""
        size = self._library.fake_cuda_kernels(None, 0)
        text = ctypes.create_string_buffer(size)
        self._library.fake_cuda_kernels(text, size)
        return text.value.decode().split()

    def reset_counters(self) -> None:
        """All counters start again at 0."""
        self._library.fake_cuda_reset_counters()

    def fail_launch(self, after: int = 0, code: int = 719) -> None:
        """The launch after `after` others breaks the device down: every later call answers `code`, too."""
        self._library.fake_cuda_fail_launch(after, code)

    def fail_allocation(self, after: int = 0) -> None:
        """The allocation after `after` others finds no memory."""
        self._library.fake_cuda_fail_allocation(after)

    def repair(self) -> None:
        """Forgets a breakdown, work in the queue and planned faults."""
        self._library.fake_cuda_repair()

    def set_order(self, order: str) -> None:
        """`forward`, `reverse` or `shuffled:SEED`, from the next launch on."""
        if self._library.fake_cuda_set_order(order.encode()):
            raise ValueError(f"no order of threads is called {order!r}")
