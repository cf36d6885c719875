"""Waiting for what changes, in this process."""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import Generator
from contextlib import contextmanager, suppress


class Changes:
    """Rings for all that watch a job; belongs to the event loop."""

    def __init__(self) -> None:
        self._watchers: defaultdict[str, set[asyncio.Event]] = defaultdict(set)

    def ring(self, id: str) -> None:
        """Tell that a job has changed."""
        for event in self._watchers.get(id, ()):
            event.set()

    def ring_all(self) -> None:
        """Tell that any job may have changed."""
        for id in self._watchers:
            self.ring(id)

    @contextmanager
    def watching(self, id: str) -> Generator[asyncio.Event, None, None]:
        """Give an event that is set at each change from now on; clear it before the job is looked at."""
        event = asyncio.Event()
        self._watchers[id].add(event)
        try:
            yield event
        finally:
            self._watchers[id].discard(event)
            if not self._watchers[id]:
                del self._watchers[id]


async def rung(event: asyncio.Event, seconds: float) -> None:
    """Wait until an event is set, or the time is over."""
    # Not `asyncio.wait_for`: before Python 3.12 it drops a cancellation that comes with the event.
    with suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            await event.wait()
