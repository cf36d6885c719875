"""What the machine could do: memory traffic and multiply-adds, measured beside the kernels."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from stereomend import _native


@dataclass(frozen=True)
class Ceiling:
    """Of so many threads together."""

    threads: int
    triad_gb_s: float
    """Memory traffic of `a = b + s * c` over arrays far larger than the caches, 12 bytes per element."""
    multiply_add_gflop_s: float
    """float32, in registers, two operations each."""


def measure_ceilings(threads: Iterable[int]) -> list[Ceiling]:
    """Measure both for each number of threads (raises MemoryError without room for the arrays)."""
    return [Ceiling(count, _native.triad(count), _native.multiply_add(count)) for count in threads]


def best_of(first: list[Ceiling], second: list[Ceiling]) -> list[Ceiling]:
    """Merge two measurements of the same thread counts: other programs only ever take away."""
    return [
        Ceiling(
            one.threads,
            max(one.triad_gb_s, other.triad_gb_s),
            max(one.multiply_add_gflop_s, other.multiply_add_gflop_s),
        )
        for one, other in zip(first, second, strict=True)
    ]
