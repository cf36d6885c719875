"""The parts of GDR at its finest level: one primal-dual iteration, and what comes before the iterations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from stereomend.bench.cases import SOLVED, Case, Setup, WxH, solve_job, worked_size
from stereomend.bench.ceilings import Ceiling
from stereomend.bench.clock import Spread, Timed
from stereomend.refinement import parse_params

OPERATIONS = 25
"""Floating-point operations per pixel and iteration; the square root and each division count as one."""
PLANE_BYTES = 48
"""Bytes per pixel and iteration if all planes went through memory in both half steps.

Dual: u_bar and p read, p written; primal: u, p, A and B read, u and u_bar written: 12 floats.
"""
FEW, MANY = 5, 55
"""Iterations of the two solves; the difference of their times is that of `MANY - FEW` iterations."""

SweepKey = tuple[Setup, int]
"""A configuration and its number of iterations."""


@dataclass(frozen=True)
class SweepTimes:
    """One configuration at the finest level, from two solves of one warp each."""

    backend: str
    worked: WxH
    threads: int
    few_ms: Spread
    many_ms: Spread
    iteration_ms: float | None
    """The slope between the medians of both; None, as all that follows from it, where noise hides it."""
    before_ms: float | None
    """What a solve takes besides: warp, descriptors and linearisation, and setting up the planes."""
    before_ns_per_pixel: float | None
    gflop_s: float | None
    """At `OPERATIONS` per pixel and iteration."""
    of_multiply_add: float | None
    """Share of the ceiling with as many threads; None where a GPU computed."""
    gb_s: float | None
    """At `PLANE_BYTES` per pixel and iteration."""
    of_triad: float | None
    """Likewise; over 1 the planes stayed in the caches."""
    speedup: float | None
    """Of an iteration over one thread; None where one thread was not measured."""


def sweep_jobs(cases: Mapping[Setup, Case]) -> dict[SweepKey, Timed]:
    """What is to be timed."""
    return {
        (setup, iterations): solve_job(case, iterations)
        for setup, case in cases.items()
        for iterations in (FEW, MANY)
    }


def sweep_times(times: Mapping[SweepKey, Spread], ceilings: Sequence[Ceiling]) -> list[SweepTimes]:
    """Derive the parts from the two solves of each configuration."""
    by_threads = {ceiling.threads: ceiling for ceiling in ceilings}
    setups = dict.fromkeys(setup for setup, _ in times)
    return [_sweep_times(setup, times, by_threads[setup.threads]) for setup in setups]


def _iteration_ms(setup: Setup, times: Mapping[SweepKey, Spread]) -> float | None:
    if (setup, FEW) not in times:
        return None
    few, many = times[setup, FEW], times[setup, MANY]
    return (many.median - few.median) / (MANY - FEW) if many.min > few.median else None


def _sweep_times(setup: Setup, times: Mapping[SweepKey, Spread], ceiling: Ceiling) -> SweepTimes:
    worked, few = worked_size(setup.size, parse_params(SOLVED)), times[setup, FEW]
    pixels, iteration_ms = worked[0] * worked[1], _iteration_ms(setup, times)
    alone_ms = _iteration_ms(setup._replace(threads=1), times)
    per_ms = None if iteration_ms is None else 1e-6 * pixels / iteration_ms
    gflop_s, gb_s = _times(OPERATIONS, per_ms), _times(PLANE_BYTES, per_ms)
    on_cpu = setup.backend != "cuda"
    before_ms = None if iteration_ms is None else max(few.median - FEW * iteration_ms, 0.0)
    return SweepTimes(
        backend=setup.backend,
        worked=worked,
        threads=setup.threads,
        few_ms=few,
        many_ms=times[setup, MANY],
        iteration_ms=iteration_ms,
        before_ms=before_ms,
        before_ns_per_pixel=_times(1e6 / pixels, before_ms),
        gflop_s=gflop_s,
        of_multiply_add=_times(1 / ceiling.multiply_add_gflop_s, gflop_s) if on_cpu else None,
        gb_s=gb_s,
        of_triad=_times(1 / ceiling.triad_gb_s, gb_s) if on_cpu else None,
        speedup=_times(alone_ms, None if iteration_ms is None else 1 / iteration_ms),
    )


def _times(factor: float | None, value: float | None) -> float | None:
    return None if factor is None or value is None else factor * value
