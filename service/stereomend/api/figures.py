"""What the server's parts say of themselves, gathered for /metrics."""

from __future__ import annotations

import asyncio
import os
import shutil
from pathlib import Path

from stereomend.api.state import Service
from stereomend.jobs.folder import BLOBS
from stereomend.jobs.meters import Figures
from stereomend.jobs.records import JobState


async def figures_of(service: Service) -> Figures:
    """Look at the queue, the workers, the ledger and the disk.

    Raises:
        NotReady: the ledger cannot be read.
        OSError: the disk cannot be asked.
    """
    depth, folder = service.pool.depth, service.settings.data_dir
    stats = await service.jobs.stats()
    return Figures(
        workers_up=service.pool.workers_up,
        queued={"refine": depth.waiting, "job": stats.counts[JobState.QUEUED]},
        running={"refine": depth.running, "job": stats.counts[JobState.RUNNING]},
        oldest_queued_s=max(depth.oldest_s, stats.oldest_queued_s),
        free_disk_bytes=await asyncio.to_thread(free_bytes, folder),
        blob_bytes=await asyncio.to_thread(_blob_bytes, folder),
    )


def free_bytes(folder: Path) -> int:
    """Free bytes of the disk that a folder is on, or would be once it is made."""
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free


def _blob_bytes(folder: Path) -> int:
    return sum(_bytes_in(folder / part) for part in BLOBS)


def _bytes_in(folder: Path) -> int:
    size = 0
    if not folder.exists():
        return 0
    with os.scandir(folder) as entries:
        for entry in entries:
            try:
                size += entry.stat().st_size
            except FileNotFoundError:  # a job ended meanwhile
                continue
    return size
