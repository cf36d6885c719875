"""Stereomend mends the disparity maps that stereo networks get wrong.

`refine` works in this process, `Client` asks a server; both return a `RefinementResult`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from stereomend.disparity import DisparityMap, Provenance, RefinementResult, StereoPair
from stereomend.errors import StereomendError

if TYPE_CHECKING:
    from stereomend.client import Client
    from stereomend.refinement import refine

__all__ = [
    "Client",
    "DisparityMap",
    "Provenance",
    "RefinementResult",
    "StereoPair",
    "StereomendError",
    "refine",
]

# The SDK must not load the kernels, nor in-process use the HTTP client.
_LAZY = {"Client": "stereomend.client", "refine": "stereomend.refinement"}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_LAZY[name]), name)
