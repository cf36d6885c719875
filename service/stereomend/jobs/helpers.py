"""Threads beside the one that works on a task, for what holds no lock: mostly to inflate and to deflate."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from threading import get_native_id
from typing import TypeVar

T = TypeVar("T")

_libc = ctypes.CDLL(None)


class Helpers:
    """A few threads that stay: to start and end them takes longer than to decode an image.

    They wake on other cores than the caller's. Left alone, the scheduler often wakes them on that one, and it
    takes longer than most calls until it moves them away.
    """

    def __init__(self, count: int) -> None:
        self._cores = os.sched_getaffinity(0)
        self._asleep: set[int] = set()
        self._pool = ThreadPoolExecutor(count, "helper")

    def start(self, call: Callable[..., T], *args: object) -> Future[T]:
        """Begin `call(*args)` in one of the threads."""
        others = self._cores - {_libc.sched_getcpu()} or self._cores
        for thread in tuple(self._asleep):
            os.sched_setaffinity(thread, others)
        return self._pool.submit(self._run, call, *args)

    def _run(self, call: Callable[..., T], *args: object) -> T:
        self._asleep.discard(get_native_id())
        # Awake on its core, it may move again if others need that one.
        os.sched_setaffinity(0, self._cores)
        try:
            return call(*args)
        finally:
            self._asleep.add(get_native_id())
