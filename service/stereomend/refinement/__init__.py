"""The method: local and global disparity refinement. Knows neither HTTP nor jobs."""

from stereomend.refinement.backends import BACKENDS, COPIES, Backend, select_backend
from stereomend.refinement.params import DEFAULT_PRESET, PRESETS, RefineParams, parse_params
from stereomend.refinement.pipeline import mend, prepare, refine, run
from stereomend.refinement.report import Mended, describe
from stereomend.refinement.watch import Watch, unwatched

__all__ = [
    "BACKENDS",
    "COPIES",
    "DEFAULT_PRESET",
    "PRESETS",
    "Backend",
    "Mended",
    "RefineParams",
    "Watch",
    "describe",
    "mend",
    "parse_params",
    "prepare",
    "refine",
    "run",
    "select_backend",
    "unwatched",
]
