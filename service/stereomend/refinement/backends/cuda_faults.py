"""After an error of the driver: can the device go on?"""

from __future__ import annotations

import ctypes

from stereomend.errors import DeviceFault

OUT_OF_MEMORY = 2

STICKY = {
    214: "uncorrectable ECC error",
    220: "uncorrectable NVLink error",
    226: "contained memory error",
    700: "illegal address",
    702: "launch timed out",
    709: "context destroyed",
    710: "assertion of a kernel",
    714: "hardware stack error",
    715: "illegal instruction",
    716: "misaligned address",
    717: "invalid address space",
    718: "invalid program counter",
    719: "launch failed",
    721: "leak of tensor memory",
    999: "unknown error",
}
"""Names of the errors (CUresult) after which every call of a process gives the same answer."""


def check_alive(said: str) -> None:
    """Wait until the current context is done with all work; call it after an error that said so much.

    Raises:
        DeviceFault: the context is lost, and with it this process's way to the device.
    """
    # Of the library that PyCUDA has loaded; PyCUDA itself keeps the number of an error to itself.
    code = ctypes.CDLL("libcuda.so.1").cuCtxSynchronize()
    if code not in (0, OUT_OF_MEMORY):
        raise DeviceFault(
            f"the GPU failed with CUDA error {code} ({STICKY.get(code, 'of no known name')}), and only a new "
            f"process can use it again; {said}"
        )
