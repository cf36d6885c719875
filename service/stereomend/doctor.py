"""What this machine has: processor, memory, clock, backends, limits, and the data folder."""

from __future__ import annotations

import os
import platform
import resource
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from stereomend.api.figures import free_bytes
from stereomend.api.tls import tls_context
from stereomend.errors import OutdatedLedger, StereomendError
from stereomend.jobs.folder import LEDGER, open_ledger
from stereomend.jobs.keys import KeyStore
from stereomend.jobs.ledger import Ledger
from stereomend.refinement import BACKENDS, select_backend
from stereomend.settings import Settings, load_settings

_MIB = 1 << 20
_WATCHED_S = 0.1
_MOST_DRIFT_S = 0.02
"""Of the clock against the monotonic one while it is watched: a daemon slews it by less than 0.1 %."""
_OWN_FILES = 128
"""Open files of a server that nobody talks to, with room to spare."""
_MOUNTS = Path("/proc/self/mountinfo")
_OF_THE_NETWORK = (
    "nfs",
    "cifs",
    "smb",
    "9p",
    "afs",
    "ceph",
    "glusterfs",
    "lustre",
    "fuse.sshfs",
    "fuse.glusterfs",
)
_LEDGER_FACTS = {"journal_mode": "wal", "synchronous": "2", "foreign_keys": "1"}
"""What the ledger's pragmas must be, or an accepted job could be lost."""


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
    yield clock()
    yield from map(_backend, BACKENDS)
    try:
        settings = load_settings()
    except StereomendError as error:
        yield Finding("settings", False, str(error))
    else:
        yield from _of_settings(settings)


def clock() -> Finding:
    """Whether the time is later than this program was installed, and nobody sets the clock right now."""
    installed = datetime.fromtimestamp(_installed_at(), UTC)
    before = _ahead_of_monotonic()
    time.sleep(_WATCHED_S)
    drift = _ahead_of_monotonic() - before
    now = datetime.fromtimestamp(time.time(), UTC)
    return Finding(
        "clock",
        now.year >= installed.year and abs(drift) < _MOST_DRIFT_S,
        f"{now:%Y-%m-%d %H:%M:%S} UTC, installed in {installed.year}; "
        f"moved by {1e3 * drift:.1f} ms against the monotonic clock in {1e3 * _WATCHED_S:.0f} ms",
    )


def data_folder(folder: Path) -> Finding:
    """Whether the folder can be written, or made, and is this user's alone."""
    if not folder.exists():
        parent = next(parent for parent in folder.absolute().parents if parent.exists())
        may = os.access(parent, os.W_OK | os.X_OK)
        made = "is made at the first start" if may else f"cannot be made: {parent} cannot be written"
        return Finding("data folder", may, f"{folder} {made}")
    if not (folder.is_dir() and os.access(folder, os.R_OK | os.W_OK | os.X_OK)):
        return Finding("data folder", False, f"{folder} is no folder, or cannot be read and written")
    found = folder.stat()
    private = found.st_uid == os.geteuid() and not found.st_mode & 0o077
    detail = f"is user {found.st_uid}'s, mode {found.st_mode & 0o777:o}; expected this user's, mode 700"
    return Finding("data folder", private, f"{folder} {detail}", needed=False)


def file_system(folder: Path, mounts: str | None = None) -> Finding:
    """Whether the ledger's locks and shared memory work there; `mounts` as in /proc/self/mountinfo."""
    kind = file_system_of(folder, _MOUNTS.read_text() if mounts is None else mounts)
    detail = f"{kind} holds {folder}; a ledger needs a file system of this machine"
    return Finding("file system", not kind.startswith(_OF_THE_NETWORK), detail)


def file_system_of(folder: Path, mounts: str) -> str:
    """The type of the file system that a folder is, or will be, in."""
    folder, found = folder.resolve(), (0, "an unknown file system")
    for line in mounts.splitlines():
        place, _, rest = line.partition(" - ")
        point = Path(place.split()[4].encode().decode("unicode_escape"))
        # Of those of one folder the last lies on top.
        if folder.is_relative_to(point) and len(point.parts) >= found[0]:
            found = len(point.parts), rest.split()[0]
    return found[1]


def free_space(settings: Settings) -> Finding:
    """Whether there is more free space than jobs leave."""
    free = free_bytes(settings.data_dir) // _MIB
    return Finding(
        "free space",
        free > settings.min_free_disk_mb,
        f"{free} MiB for {settings.data_dir}; jobs leave {settings.min_free_disk_mb} MiB free",
    )


def open_files(settings: Settings) -> Finding:
    """Whether every request that may wait can have its connection and a file."""
    most, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = _OWN_FILES + 2 * settings.max_queued_jobs
    unlimited = most == resource.RLIM_INFINITY
    detail = f"{'unlimited' if unlimited else most}; {settings.max_queued_jobs} queued jobs need {needed}"
    return Finding("open files", unlimited or most >= needed, detail)


def pragmas(ledger: Ledger) -> Finding:
    """Whether the ledger's database keeps what it was told to keep."""
    facts = ledger.check()
    wrong = [name for name, wanted in _LEDGER_FACTS.items() if facts[name] != wanted]
    shown = ", ".join(f"{name} {facts[name]}" for name in _LEDGER_FACTS)
    return Finding("ledger", not wrong, f"{shown}{'; wrong: ' if wrong else ''}{', '.join(wrong)}")


def keys(settings: Settings, in_store: int) -> Finding:
    """Whether there is a key where one is needed."""
    count = len(settings.api_keys) + in_store
    return Finding(
        "API keys",
        bool(count) or not settings.reachable,
        f"{in_store} in the data folder, {len(settings.api_keys)} in the settings; "
        f"requests to {settings.host} need {'one' if count or settings.reachable else 'none'}",
    )


def _installed_at() -> float:
    return Path(__file__).stat().st_mtime


def _ahead_of_monotonic() -> float:
    """The clock minus the monotonic one [s], from the reading that was least interrupted."""
    readings = [(time.monotonic(), time.time(), time.monotonic()) for _ in range(20)]
    began, now, ended = min(readings, key=lambda reading: reading[2] - reading[0])
    return now - (began + ended) / 2


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


def _of_settings(settings: Settings) -> Iterator[Finding]:
    yield Finding(
        "settings",
        True,
        f"{settings.host} port {settings.port}, {settings.workers} worker(s) of "
        f"{settings.threads_per_worker} thread(s), at most {settings.max_upload_mb} MiB and "
        f"{settings.max_pixels} px per image",
    )
    yield _tls(settings)
    yield open_files(settings)
    yield data_folder(settings.data_dir)
    yield file_system(settings.data_dir)
    yield free_space(settings)
    yield from _in_folder(settings)


def _tls(settings: Settings) -> Finding:
    try:
        context = tls_context(settings)
    except StereomendError as error:
        return Finding("TLS", False, str(error))
    return Finding("TLS", True, f"certificate {settings.tls_certfile}" if context else "off")


def _in_folder(settings: Settings) -> Iterator[Finding]:
    # To look must not make anything.
    if not (settings.data_dir / LEDGER).exists():
        yield Finding("ledger", True, "none yet; it is made at the first start")
        yield keys(settings, 0)
        return
    try:
        with closing(open_ledger(settings.data_dir, migrate=False)) as ledger:
            yield pragmas(ledger)
            yield keys(settings, len(KeyStore(ledger.engine).live()))
    except OutdatedLedger as error:
        yield Finding("ledger", True, str(error))
    except StereomendError as error:
        yield Finding("ledger", False, str(error))
