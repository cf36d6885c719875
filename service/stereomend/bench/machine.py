"""What the figures were measured on."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from stereomend import _native


@dataclass(frozen=True)
class Machine:
    """Processor and versions; figures of two machines compare only with both at hand."""

    cpu: str
    cores: int
    """Cores this process may use."""
    system: str
    python: str
    versions: dict[str, str]
    kernel: str
    """Hash of the kernels' sources."""
    instruction_set: str


def this_machine() -> Machine:
    """Describe this machine (raises nothing: what cannot be found out is `unknown`)."""
    packages = ("stereomend", "numpy", "opencv-python-headless")
    return Machine(
        cpu=_cpu(),
        cores=cores(),
        system=platform.platform(),
        python=platform.python_version(),
        versions={name: version(name) for name in packages},
        kernel=_native.KERNEL_HASH,
        instruction_set=next(iter(_native.instruction_sets()), "unknown"),
    )


def machine_lines(machine: Machine) -> Iterator[str]:
    """The lines that stand over all tables."""
    yield f"{machine.cpu}, {machine.cores} cores; {machine.instruction_set}, kernels {machine.kernel}"
    packages = ", ".join(f"{name} {version}" for name, version in machine.versions.items())
    yield f"Python {machine.python}, {packages}"


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0))


def load() -> float:
    """Processes that ran or wanted to, on average over the last minute."""
    return round(os.getloadavg()[0], 2)


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or "unknown")
