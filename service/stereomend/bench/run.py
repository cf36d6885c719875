"""One run of the benchmark: everything measured, then derived."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from stereomend.bench.cases import Setup, WxH, make_cases
from stereomend.bench.ceilings import Ceiling, best_of, measure_ceilings
from stereomend.bench.clock import interleaved
from stereomend.bench.http import HttpTimes, time_http
from stereomend.bench.machine import Machine, cores, load, this_machine
from stereomend.bench.stages import StageTimes, stage_jobs, stage_times
from stereomend.bench.sweeps import SweepTimes, sweep_jobs, sweep_times
from stereomend.errors import InvalidParameter
from stereomend.refinement import PRESETS

SMALLEST_SIDE = 32
"""Of an input [px]; less leaves nothing to measure."""
MOST_THREADS = 1024
PAPER_SIZE = (360, 288)
"""Width and height of the paper's images [px]."""
PAPER_MS = {"LDR on an Intel i9": 118.0, "GDR on an Nvidia Titan X": 375.0}
"""What the paper reports for images of `PAPER_SIZE` [ms]."""


@dataclass(frozen=True)
class Plan:
    """What to measure."""

    sizes: tuple[WxH, ...] = ((720, 576), (1280, 1024), (2560, 2048))
    """Of the input; it is worked at half of that."""
    presets: tuple[str, ...] = tuple(PRESETS)
    backends: tuple[str, ...] = ("native",)
    threads: tuple[int, ...] = ()
    """Empty: 1, 2 and all cores."""
    repeats: int = 9
    http_requests: int = 30
    """0 leaves the server out."""
    http_size: WxH = (720, 576)


QUICK = Plan(sizes=((160, 128),), repeats=2, http_requests=3, http_size=(160, 128))
"""A few seconds: whether it works, not how fast."""


def plan_of(given: Mapping[str, Any], quick: bool = False, http: bool = True) -> Plan:
    """Complete what a person gave: `size`, `preset`, `backend`, `threads` (each several) and `repeats`.

    Raises:
        InvalidParameter: a number is out of range.
    """
    plan = QUICK if quick else Plan()
    plan = replace(
        plan,
        sizes=tuple(given.get("size", plan.sizes)),
        presets=tuple(given.get("preset", plan.presets)),
        backends=tuple(given.get("backend", plan.backends)),
        threads=tuple(given.get("threads", plan.threads)),
        repeats=given.get("repeats", plan.repeats),
        http_requests=plan.http_requests if http else 0,
    )
    _check(plan)
    return plan


def _check(plan: Plan) -> None:
    for width, height in plan.sizes:
        if min(width, height) < SMALLEST_SIDE:
            raise InvalidParameter(f"--size {width}x{height}: expected sides of at least {SMALLEST_SIDE} px")
    for count in plan.threads:
        if not 1 <= count <= MOST_THREADS:
            raise InvalidParameter(f"--threads {count}: expected 1 to {MOST_THREADS}")
    if plan.repeats < 1:
        raise InvalidParameter(f"--repeats {plan.repeats}: expected at least 1")


@dataclass(frozen=True)
class Report:
    """All figures of one run."""

    machine: Machine
    load_before: float
    """Processes that ran or wanted to, on average over the minute before."""
    load_after: float
    plan: Plan
    ceilings: list[Ceiling]
    stages: list[StageTimes]
    sweeps: list[SweepTimes]
    http: list[HttpTimes]


def run_bench(plan: Plan) -> Report:
    """Measure all that is planned.

    Raises:
        BackendUnavailable: a backend does not work on this machine.
        InvalidParameter: a preset is unknown.
        NotReady: the server does not start.
    """
    before, threads = load(), plan.threads or _default_threads()
    first = measure_ceilings(threads)
    cases = make_cases(_setups(plan, threads))
    stages = stage_times(interleaved(stage_jobs(cases, plan.presets), plan.repeats))
    solves = interleaved(sweep_jobs(cases), plan.repeats)
    ceilings = best_of(first, measure_ceilings(threads))
    http = [time_http(plan.http_size, preset, plan.http_requests) for preset in _served(plan)]
    sweeps = sweep_times(solves, ceilings)
    return Report(this_machine(), before, load(), plan, ceilings, stages, sweeps, http)


def as_json(report: Report) -> str:
    """All figures as a JSON object, with those of the paper beside them."""
    paper = {"worked": PAPER_SIZE, "ms": PAPER_MS}
    return json.dumps(asdict(report) | {"paper": paper}, indent=1) + "\n"


def _default_threads() -> tuple[int, ...]:
    return tuple(sorted({count for count in (1, 2, cores()) if count <= cores()}))


def _setups(plan: Plan, threads: tuple[int, ...]) -> list[Setup]:
    # NumPy's part of the reference backend knows no threads.
    return [
        Setup(backend, size, count)
        for size in plan.sizes
        for backend in plan.backends
        for count in (threads if backend != "reference" else threads[:1])
    ]


def _served(plan: Plan) -> tuple[str, ...]:
    return plan.presets if plan.http_requests else ()
