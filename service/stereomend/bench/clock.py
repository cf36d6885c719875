"""Taking times: every configuration once per round, so that a drift of the machine meets all alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from time import perf_counter
from typing import NamedTuple, TypeVar

from stereomend.opencv import cv2

_SHORT_MS = 50.0

Key = TypeVar("Key")


@dataclass(frozen=True)
class Spread:
    """Milliseconds of some repeats."""

    median: float
    min: float
    max: float

    @classmethod
    def of(cls, times_ms: Sequence[float]) -> Spread:
        """Summarise at least one time."""
        return cls(median(times_ms), min(times_ms), max(times_ms))


class Timed(NamedTuple):
    """Something to take the time of, and the threads that OpenCV may use meanwhile."""

    call: Callable[[], object]
    threads: int


def interleaved(jobs: Mapping[Key, Timed], repeats: int) -> dict[Key, Spread]:
    """Time each job `repeats` times, round by round.

    Short jobs run once unmeasured before each time, or they would pay for the caches that others emptied.
    """
    times: dict[Key, list[float]] = {key: [] for key in jobs}
    before = cv2.getNumThreads()
    try:
        for _ in range(repeats):
            for key, job in jobs.items():
                cv2.setNumThreads(job.threads)
                times[key].append(_time_ms(job.call))
    finally:
        cv2.setNumThreads(before)
    return {key: Spread.of(values) for key, values in times.items()}


def _time_ms(call: Callable[[], object]) -> float:
    first = _once_ms(call)
    return first if first > _SHORT_MS else _once_ms(call)


def _once_ms(call: Callable[[], object]) -> float:
    began = perf_counter()
    call()
    return 1e3 * (perf_counter() - began)
