import numpy as np
import numpy.typing as npt

_Plane = npt.NDArray[np.float32]
_Flags = npt.NDArray[np.bool_]

KERNEL_HASH: str

def instruction_sets() -> list[str]: ...
def solve(
    left: _Plane,
    right: _Plane,
    u: _Plane,
    *,
    warps: int,
    iterations: int,
    data_weight: float,
    huber_epsilon: float,
    tau: float,
    sigma: float,
    absolute: bool,
    threads: int,
    instruction_set: str = "",
) -> _Plane: ...
def distance(left: _Plane, right: _Plane, u: _Plane, *, absolute: bool, threads: int) -> _Plane: ...
def confidence(
    left: _Plane,
    right: _Plane,
    u: _Plane,
    valid: _Flags,
    matte: _Flags,
    *,
    window: int,
    smoothness_weight: float,
    smoothness_power: int,
    photometric_weight: float,
    threads: int,
) -> _Plane: ...
def fill(u: _Plane, known: _Flags, *, steps: int, passes: int, threads: int) -> _Plane: ...
