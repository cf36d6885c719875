"""The implementations of the method, and the choice among them."""

from __future__ import annotations

import os

from stereomend.errors import BackendUnavailable
from stereomend.refinement.backends.base import Backend
from stereomend.refinement.backends.data import (
    CELL,
    COPIES,
    HALF,
    BendRule,
    Cells,
    ChoiceRule,
    GlintRule,
    Ground,
    GroundRule,
    Grounds,
    Guide,
    OcclusionRule,
    Offer,
    Origins,
    Plane,
    PollRule,
    Polls,
    Problem,
    Reading,
    ReuseRule,
    Rivals,
    Size,
    Solved,
    Sparse,
    SpeckleRule,
    Tick,
    Usable,
)
from stereomend.refinement.backends.reference import ReferenceBackend

__all__ = [
    "BACKENDS",
    "CELL",
    "COPIES",
    "HALF",
    "Backend",
    "BendRule",
    "Cells",
    "ChoiceRule",
    "GlintRule",
    "Ground",
    "GroundRule",
    "Grounds",
    "Guide",
    "OcclusionRule",
    "Offer",
    "Origins",
    "Plane",
    "PollRule",
    "Polls",
    "Problem",
    "Reading",
    "ReuseRule",
    "Rivals",
    "Size",
    "Solved",
    "Sparse",
    "SpeckleRule",
    "Tick",
    "Usable",
    "select_backend",
]

BACKENDS = ("auto", "cuda", "native", "reference")


def select_backend(name: str = "auto", threads: int = 0) -> Backend:
    """Choose what computes: `auto` takes cuda where it works, else native.

    Args:
        name: one of `BACKENDS`.
        threads: threads to compute with; 0 means one per core this process may use.

    Raises:
        BackendUnavailable: there is no such backend, or it does not work on this machine.
    """
    if name == "reference":
        return ReferenceBackend("asked for")
    if name == "native":
        return _native(threads, "asked for")
    if name == "cuda":
        return _cuda(threads, "asked for")
    if name == "auto":
        return _best(threads)
    raise BackendUnavailable(f"backend: got {name!r}, expected one of {', '.join(BACKENDS)}")


def _best(threads: int) -> Backend:
    try:
        return _cuda(threads, "auto: a GPU is there")
    except BackendUnavailable as error:
        return _native(threads, f"auto: the C++ kernels; {error}")


def _cuda(threads: int, reason: str) -> Backend:
    # The CPU's part first: without it the device is of no use.
    _native(1, reason)
    from stereomend.refinement.backends.cuda import CudaBackend

    return CudaBackend(threads or len(os.sched_getaffinity(0)), reason)


def _native(threads: int, reason: str) -> Backend:
    try:
        from stereomend import _native as kernels
        from stereomend.refinement.backends.native import NativeBackend
    except ImportError as error:
        raise BackendUnavailable(f"native: the compiled kernels do not load: {error}") from error
    sets = kernels.instruction_sets()
    if not sets:
        raise BackendUnavailable("native: this processor lacks SSE 4.2, which the kernels need")
    return NativeBackend(threads or len(os.sched_getaffinity(0)), f"{reason} ({sets[0]})")
