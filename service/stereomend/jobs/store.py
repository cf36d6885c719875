"""The data folder of a server: its ledger, its blobs, and the lock that keeps a second server out."""

from __future__ import annotations

import asyncio
import fcntl
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import ParamSpec, TypeVar

from stereomend.errors import ConfigurationError, DiskFull
from stereomend.jobs.blobs import BlobStore
from stereomend.jobs.folder import open_ledger
from stereomend.jobs.records import JobState, Room
from stereomend.settings import Settings

P = ParamSpec("P")
T = TypeVar("T")

_LOCK_PATIENCE_S = 3.0
"""A server that was killed a moment ago may not be gone yet."""
_THREADS = 4


class Store:
    """Ledger and blobs, all of which block: from the event loop they are called through `ask` and `move`."""

    def __init__(self, settings: Settings, on_ended: Callable[[JobState], None]) -> None:
        """Lock and open the folder, and migrate the ledger; blocks. `on_ended`: as `Ledger.open`.

        Raises:
            ConfigurationError: the folder cannot be used, or another server uses it.
        """
        self._settings = settings
        self._lock = _locked(settings.data_dir)
        try:
            self.blobs = BlobStore(settings.data_dir)
            self.ledger = open_ledger(settings.data_dir, on_ended)
        except BaseException:
            os.close(self._lock)
            raise
        # Apart, so that no lease runs out while uploads are written.
        self._asking = ThreadPoolExecutor(_THREADS, "ledger")
        self._moving = ThreadPoolExecutor(_THREADS, "blobs")

    async def ask(self, call: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Call the ledger in a thread."""
        return await asyncio.get_running_loop().run_in_executor(self._asking, lambda: call(*args, **kwargs))

    async def move(self, call: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Read or write blobs, or compute what takes long, in another thread."""
        return await asyncio.get_running_loop().run_in_executor(self._moving, lambda: call(*args, **kwargs))

    def room(self, size: int = 0) -> Room:
        """What may wait and run now; blocks (raises DiskFull: the disk has no room for `size` bytes more)."""
        settings = self._settings
        free = self.blobs.free_bytes() - (settings.min_free_disk_mb << 20)
        if free < size:
            error = DiskFull(
                f"{size >> 20} MiB came, and the disk has {max(0, free) >> 20} MiB of room; "
                f"{settings.min_free_disk_mb} MiB stay free"
            )
            error.retry_after = 30
            raise error
        return Room(
            settings.max_queued_jobs, settings.max_queued_mb << 20, settings.max_jobs_per_key, max(0, free)
        )

    def close(self) -> None:
        """Let go of the folder; waits for the threads."""
        self._asking.shutdown()
        self._moving.shutdown()
        self.ledger.close()
        os.close(self._lock)


def _locked(folder: Path) -> int:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        lock = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o600)
    except OSError as error:
        raise ConfigurationError(
            f"the data folder {folder} cannot be used: {error.strerror}; data_dir names another"
        ) from error
    deadline = time.monotonic() + _LOCK_PATIENCE_S
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return lock
        except OSError as error:
            if time.monotonic() > deadline:
                os.close(lock)
                raise ConfigurationError(
                    f"the data folder {folder} is in use by another server; data_dir names another"
                ) from error
        time.sleep(0.05)
