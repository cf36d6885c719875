from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

_Plane = npt.NDArray[np.float32]
_Flags = npt.NDArray[np.bool_]
_Samples = npt.NDArray[np.generic]

KERNEL_HASH: str

def instruction_sets() -> list[str]: ...
def triad(threads: int) -> float: ...
def multiply_add(threads: int) -> float: ...
def find_chunks(
    file: npt.NDArray[np.uint8], at: int, most: int
) -> tuple[list[tuple[int, int, int]], int]: ...
def unfilter(
    filtered: npt.NDArray[np.uint8], height: int, stride: int, bytes_per_pixel: int
) -> npt.NDArray[np.uint8]: ...
def filter_levels(plane: _Plane, scale: float) -> npt.NDArray[np.uint8]: ...

class SolverParams:
    def __init__(
        self,
        *,
        data_weight: float,
        huber_epsilon: float,
        tau: float,
        sigma: float,
        warps: int,
        iterations: int,
        absolute: bool,
        observed_only: bool = False,
        averaging: float = 0.0,
    ) -> None: ...

class ConfidenceParams:
    def __init__(
        self, *, window: int, smoothness_weight: float, smoothness_power: int, photometric_weight: float
    ) -> None: ...

class TrustParams:
    def __init__(self, *, least: float, full: float, smallest: float) -> None: ...

class SpeckleRule:
    def __init__(self, *, largest: int, step: float) -> None: ...

class PollRule:
    def __init__(
        self,
        *,
        tolerance: float,
        near: float,
        lack: float,
        most: float,
        least: float,
        full: float,
        frame: float,
    ) -> None: ...

class ChoiceRule:
    def __init__(
        self,
        *,
        near: float,
        enough: float,
        full_trust: float,
        high_trust: float,
        win_margin: float,
        trusted_margin: float,
        weak_share: float,
        spike: float,
        rough_share: float,
        step: float,
        soft_edge: float,
        largest_patch: int,
    ) -> None: ...

class GroundRule:
    def __init__(
        self,
        *,
        trust: float,
        evidence: float,
        far_share: float,
        min_trust: float,
        full_trust: float,
        worse_by: float,
        equal_within: float,
        far: float,
    ) -> None: ...

class BendRule:
    def __init__(self, *, window: float, bend: float, flat: float) -> None: ...

class Engine:
    def __init__(self, threads: int, instruction_set: str = "") -> None: ...
    def solve(
        self,
        left: _Plane,
        right: _Plane,
        u: _Plane,
        weight: _Plane | None,
        params: SolverParams,
        edge: _Plane | None = None,
        prior: _Plane | None = None,
        trust: _Plane | None = None,
        tick: Callable[[], None] | None = None,
    ) -> _Plane: ...
    def evidence(self, left: _Plane, right: _Plane, maps: Sequence[_Plane]) -> list[_Plane]: ...
    def better(
        self,
        left: _Plane,
        right: _Plane,
        u: _Plane,
        other: _Plane,
        margin: float,
        least: float,
        apart: float,
    ) -> _Plane: ...
    def halve(self, planes: Sequence[_Plane]) -> list[_Plane]: ...
    def halve_weighed(self, u: _Plane, weight: _Plane) -> tuple[_Plane, _Plane]: ...
    def shrink(self, samples: _Samples, height: int, width: int, grey: bool = False) -> list[_Plane]: ...
    def merge(
        self,
        u: _Plane,
        share: _Plane,
        sample: _Plane,
        upload: _Plane,
        valid: _Flags,
        near: float,
        half: float,
    ) -> _Plane: ...
    def shrink_sparse(
        self, u: _Plane, valid: _Flags, height: int, width: int, half: float
    ) -> tuple[_Plane, _Flags]: ...
    def sample_sparse(self, u: _Plane, valid: _Flags, height: int, width: int) -> tuple[_Plane, _Flags]: ...
    def tell(
        self,
        u: _Plane,
        initial: _Plane,
        valid: _Flags,
        kept: _Flags,
        scene: _Flags | None,
        within: float,
    ) -> tuple[npt.NDArray[np.uint8], list[int]]: ...
    def trust(
        self,
        left: _Plane,
        right: _Plane,
        u: _Plane,
        valid: _Flags,
        matte: _Flags,
        params: TrustParams,
        rule: SpeckleRule,
    ) -> _Plane: ...
    def speckles(self, u: _Plane, valid: _Flags, rule: SpeckleRule) -> _Flags: ...
    def edge_weights(
        self, channels: Sequence[_Plane], level: float, power: float, floor: float
    ) -> _Plane: ...
    def glints(
        self, channels: Sequence[_Plane], saturation: float, bright: float, nearly: float
    ) -> tuple[_Flags, _Flags]: ...
    def poll(
        self,
        views: tuple[_Plane, _Flags, _Plane, _Plane, _Plane, _Flags, _Flags],
        matte: _Flags,
        spoilt: _Flags,
        rule: PollRule,
    ) -> npt.NDArray[np.float64]: ...
    def ground(
        self, polls: npt.NDArray[np.float64], height: int, width: int, rule: GroundRule
    ) -> list[_Plane]: ...
    def bend(self, u: _Plane, polls: npt.NDArray[np.float64], rule: BendRule) -> _Plane: ...
    def choose(
        self,
        views: tuple[_Plane, _Flags, _Plane, _Plane, _Plane, _Flags, _Flags],
        facts: tuple[_Plane, _Plane, _Plane, _Plane, _Flags, _Flags],
        rule: ChoiceRule,
    ) -> _Plane: ...
    def fill_occlusions(
        self, u: _Plane, known: _Flags, step: float, stretch: float, slack: float
    ) -> tuple[_Plane, _Flags]: ...
    def reach(self, seeds: _Flags, passing: _Flags, soft: _Flags, u: _Plane, step: float) -> _Flags: ...
    def mismatch(
        self, left: _Plane, readings: Sequence[tuple[_Plane, _Plane, _Flags]]
    ) -> list[tuple[float, int]]: ...
    def unobserved(self, u: _Plane) -> _Flags: ...
    def shown(self, u: _Plane, valid: _Flags) -> tuple[_Flags, _Flags]: ...
    def confidence(
        self, left: _Plane, right: _Plane, u: _Plane, valid: _Flags, matte: _Flags, params: ConfidenceParams
    ) -> _Plane: ...
    def fill(self, u: _Plane, known: _Flags, steps: int, passes: int) -> _Plane: ...
