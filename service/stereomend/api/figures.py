"""What the server's parts say of themselves, gathered for /metrics."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path

from stereomend.api.state import Service
from stereomend.jobs.meters import Figures


async def figures_of(service: Service) -> Figures:
    """Look at the queue, the workers and the disk (raises OSError if the disk cannot be asked)."""
    depth = service.pool.depth
    return Figures(
        workers_up=service.pool.workers_up,
        queued={"refine": depth.waiting},
        running={"refine": depth.running},
        oldest_queued_s=depth.oldest_s,
        free_disk_bytes=await asyncio.to_thread(free_bytes, service.settings.data_dir),
    )


def free_bytes(folder: Path) -> int:
    """Free bytes of the disk that a folder is on, or would be once it is made."""
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free
