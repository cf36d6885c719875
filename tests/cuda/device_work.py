"""What the tests run on the emulated device, each function in a process of its own."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from fakecuda import Counters, FakeDevice, HostCounters
from fakecuda.arguments import check_formats
from fakecuda.build import CACHE

from stereomend.disparity import RefinementResult
from stereomend.refinement import refine, select_backend
from stereomend.refinement.backends import Guide, Problem, Solved, cuda, cuda_plan, cuda_solver
from stereomend.refinement.backends.cuda import CudaBackend, PyCudaDevice
from stereomend.refinement.backends.cuda_compile import Sources
from stereomend.refinement.stage_params import GdrParams

Case = tuple[tuple[np.ndarray, np.ndarray, np.ndarray], GdrParams, np.ndarray | None, Guide]
"""Left, right and u; parameters, weight of the data term and guide of one solve."""


@dataclass
class Counted:
    """A map, and what the device counted while it was made."""

    u: np.ndarray
    kernels: dict[str, Counters]
    host: HostCounters


class CheckedDevice(PyCudaDevice):
    """Refuses kernels that read their arguments as other types than the host packs."""

    def _load(self, ptx: bytes) -> None:
        check_formats(ptx.decode(), cuda_solver.ARGUMENTS)
        super()._load(ptx)


cuda.PyCudaDevice = CheckedDevice


def backend_of(sources: Sources | None = None) -> CudaBackend:
    # Compiled kernels stay with the fake driver's.
    os.environ["XDG_CACHE_HOME"] = str(CACHE)
    return CudaBackend(1, "test", sources)


def globally(problem: Problem, params: GdrParams, repeats: int = 1) -> list[Counted]:
    device, backend = FakeDevice(), backend_of()
    found = []
    for _ in range(repeats):
        device.reset_counters()
        u = backend.globally(problem, params).u
        counters = {name: device.counters(name) for name in device.kernels()}
        found.append(Counted(u, counters, device.host()))
    return found


def solve(cases: Sequence[Case]) -> list[np.ndarray]:
    backend = backend_of()
    return [
        backend.solve(*state, params, weight=weight, guide=guide) for state, params, weight, guide in cases
    ]


def solve_edited(case: Case, texts: Mapping[str, str], arguments: Mapping[str, str]) -> np.ndarray:
    """With other kernels, or other types of their arguments, than those installed."""
    cuda_solver.ARGUMENTS.update(arguments)
    backend = backend_of(Sources(texts))
    state, params, weight, guide = case
    return backend.solve(*state, params, weight=weight, guide=guide)


def solve_in_place(case: Case) -> np.ndarray:
    """As if there were one set of planes instead of two."""
    two = cuda_solver._Level.state
    cuda_solver._Level.state = lambda level, _: two(level, 0)
    return solve([case])[0]


def solve_too_long(case: Case, longest: int) -> tuple[np.ndarray, list[str]]:
    """And the kernels that ran, on a device whose launches reach so far."""
    cuda_plan.LONGEST_SIDE = longest
    found = solve([case])[0]
    return found, FakeDevice().kernels()


def refined(pair: Sequence[np.ndarray], params: Mapping[str, Any], backend: str) -> RefinementResult:
    os.environ["XDG_CACHE_HOME"] = str(CACHE)
    return refine(*pair, backend=backend, threads=1, **params)


def chosen(name: str) -> tuple[str, str, str]:
    os.environ["XDG_CACHE_HOME"] = str(CACHE)
    backend = select_backend(name, 1)
    return backend.name, backend.reason, backend.kernel


def solved_globally(problems: Sequence[tuple[Problem, GdrParams]]) -> list[Solved]:
    backend = backend_of()
    # What is pickled has no use for a read-only mapping, which cannot be.
    return [portable(backend.globally(*problem)) for problem in problems]


def portable(solved: Solved) -> Solved:
    return solved._replace(copies=dict(solved.copies))


def after_a_fault(problem: Problem, params: GdrParams) -> list[str]:
    """What three solves say, the first of which meets a fault."""
    device, backend = FakeDevice(), backend_of()
    device.fail_launch(after=2, code=700)
    return [complaint(backend, problem, params) for _ in range(3)]


def after_an_error(problem: Problem, params: GdrParams, code: int) -> tuple[str, np.ndarray]:
    """What a solve says, one launch of which fails with `code`, and what comes of the next."""
    device, backend = FakeDevice(), backend_of()
    device.fail_launch(after=2, code=code)
    return complaint(backend, problem, params), backend.globally(problem, params).u


def complaint(backend: CudaBackend, problem: Problem, params: GdrParams) -> str:
    try:
        backend.globally(problem, params)
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "fine"


def out_of_bounds(problem: Problem, params: GdrParams) -> None:
    """A plane of the device is one pixel shorter than the kernels believe."""
    whole = cuda_solver._Level.plane

    def shorter(level: Any, name: str, count: int = 1) -> int:
        if name == "a" and name not in level._kept:
            level._kept[name] = level._device.allocate(level.size[0] * level.size[1] - 1)
        return whole(level, name, count)

    cuda_solver._Level.plane = shorter
    backend_of().globally(problem, params)


def short_of_memory(
    problem: Problem, params: GdrParams, allocations: int
) -> list[tuple[Solved, Solved, int]]:
    """For each allocation of a solve: it fails, then another solve; and what the first one left allocated."""
    device, outcomes = FakeDevice(), []
    for after in range(allocations):
        backend = backend_of()
        device.reset_counters()
        device.fail_allocation(after)
        without = portable(backend.globally(problem, params))
        kept = device.host().allocations - device.host().frees
        outcomes.append((without, portable(backend.globally(problem, params)), kept))
    return outcomes
