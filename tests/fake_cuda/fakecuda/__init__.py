"""Runs CUDA code through unmodified PyCUDA on a machine without a GPU. See the README beside this package."""

from fakecuda.build import driver_folder, missing_tools, ptx_of
from fakecuda.device import Counters, FakeDevice, HostCounters
from fakecuda.runner import Failed, run

__all__ = [
    "Counters",
    "Failed",
    "FakeDevice",
    "HostCounters",
    "driver_folder",
    "missing_tools",
    "ptx_of",
    "run",
]
