"""Times of LDR and GDR at working size."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from stereomend.bench.cases import Case, Setup, WxH, global_job, local_job, worked_size
from stereomend.bench.clock import Spread, Timed
from stereomend.refinement import parse_params


@dataclass(frozen=True)
class StageKey:
    """What a time belongs to; `stage` is `ldr` or `gdr`."""

    setup: Setup
    preset: str
    stage: str


@dataclass(frozen=True)
class StageTimes:
    """LDR (confidence and fill) and GDR (all levels) of one configuration."""

    backend: str
    input: WxH
    worked: WxH
    threads: int
    preset: str
    ldr_ms: Spread
    gdr_ms: Spread
    ldr_ns_per_pixel: float
    """Per pixel of the working size, by medians."""
    gdr_ns_per_pixel: float
    ldr_speedup: float | None
    """Over one thread, by medians; None where one thread was not measured."""
    gdr_speedup: float | None


def stage_jobs(cases: Mapping[Setup, Case], presets: Iterable[str]) -> dict[StageKey, Timed]:
    """What is to be timed (raises InvalidParameter for an unknown preset)."""
    jobs: dict[StageKey, Timed] = {}
    for preset in presets:
        params = parse_params({"preset": preset})
        for setup, case in cases.items():
            jobs[StageKey(setup, preset, "ldr")] = local_job(case, params)
            jobs[StageKey(setup, preset, "gdr")] = global_job(case, params)
    return jobs


def stage_times(times: Mapping[StageKey, Spread]) -> list[StageTimes]:
    """Bring both stages of each configuration together."""
    configurations = dict.fromkeys((key.setup, key.preset) for key in times)
    return [_stage_times(setup, preset, times) for setup, preset in configurations]


def speedup(one: Spread | None, many: Spread) -> float | None:
    """How many times faster than with one thread, by medians."""
    return None if one is None else one.median / many.median


def _stage_times(setup: Setup, preset: str, times: Mapping[StageKey, Spread]) -> StageTimes:
    worked = worked_size(setup.size, parse_params({"preset": preset}))
    alone = setup._replace(threads=1)
    pixels = worked[0] * worked[1]
    ldr, gdr = (times[StageKey(setup, preset, stage)] for stage in ("ldr", "gdr"))
    return StageTimes(
        backend=setup.backend,
        input=setup.size,
        worked=worked,
        threads=setup.threads,
        preset=preset,
        ldr_ms=ldr,
        gdr_ms=gdr,
        ldr_ns_per_pixel=1e6 * ldr.median / pixels,
        gdr_ns_per_pixel=1e6 * gdr.median / pixels,
        ldr_speedup=speedup(times.get(StageKey(alone, preset, "ldr")), ldr),
        gdr_speedup=speedup(times.get(StageKey(alone, preset, "gdr")), gdr),
    )
