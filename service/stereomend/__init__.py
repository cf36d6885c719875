"""Stereomend mends the disparity maps that stereo networks get wrong.

`refine` works in this process, `Client` and `AsyncClient` ask a server; all return a `RefinementResult`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from stereomend.errors import StereomendError

if TYPE_CHECKING:
    from stereomend.client import AsyncClient, Client
    from stereomend.disparity import Calibration, DisparityMap, Provenance, RefinementResult, StereoPair
    from stereomend.refinement import refine

__all__ = [
    "AsyncClient",
    "Calibration",
    "Client",
    "DisparityMap",
    "Provenance",
    "RefinementResult",
    "StereoPair",
    "StereomendError",
    "refine",
]

# The SDK must not load the kernels, in-process use not the HTTP client, and the supervisor not even NumPy.
_LAZY = {
    "AsyncClient": "stereomend.client",
    "Calibration": "stereomend.disparity",
    "Client": "stereomend.client",
    "DisparityMap": "stereomend.disparity",
    "Provenance": "stereomend.disparity",
    "RefinementResult": "stereomend.disparity",
    "StereoPair": "stereomend.disparity",
    "refine": "stereomend.refinement",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_LAZY[name]), name)
