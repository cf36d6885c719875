"""What this machine has: processor, memory, disk, backends and limits."""

from __future__ import annotations

import os
import platform
import shutil
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from typing import NamedTuple

from stereomend.errors import StereomendError
from stereomend.refinement import BACKENDS, select_backend
from stereomend.settings import load_settings

_MIB = 1 << 20


class Finding(NamedTuple):
    """One line of the doctor's report."""

    what: str
    fine: bool
    detail: str
    needed: bool = True
    """Whether the server cannot run without it."""


def examine() -> Iterator[Finding]:
    """Look at everything a server needs (nothing is raised: what fails is a finding)."""
    yield Finding("stereomend", True, f"{version('stereomend')} on Python {platform.python_version()}")
    yield Finding(
        "system", platform.system() == "Linux", f"{platform.platform()}; Linux is supported", needed=False
    )
    yield Finding("cores", True, f"{len(os.sched_getaffinity(0))} usable")
    yield _memory()
    yield _disk()
    yield from map(_backend, BACKENDS)
    yield _settings()


def _memory() -> Finding:
    total, free = (
        os.sysconf(name) * os.sysconf("SC_PAGE_SIZE") // _MIB for name in ("SC_PHYS_PAGES", "SC_AVPHYS_PAGES")
    )
    return Finding("memory", total >= 1024, f"{total} MiB, {free} MiB of it unused; 1024 MiB are needed")


def _disk() -> Finding:
    folder = tempfile.gettempdir()
    return Finding(
        "disk", os.access(folder, os.W_OK), f"{folder}: {shutil.disk_usage(folder).free // _MIB} MiB free"
    )


def _backend(name: str) -> Finding:
    try:
        backend = select_backend(name)
    except StereomendError as error:
        return Finding(f"backend {name}", False, str(error), needed=name == "auto")
    return Finding(f"backend {name}", True, f"{backend.name}: {backend.reason}, kernels {backend.kernel}")


def _settings() -> Finding:
    try:
        settings = load_settings()
    except StereomendError as error:
        return Finding("settings", False, str(error))
    keys = f"{len(settings.api_keys)} API key{'s' if len(settings.api_keys) != 1 else ''}"
    return Finding(
        "settings",
        True,
        f"http://{settings.host}:{settings.port}, {keys}, {settings.workers} worker(s) of "
        f"{settings.threads_per_worker} thread(s), at most {settings.max_upload_mb} MiB and "
        f"{settings.max_pixels} px per image",
    )
