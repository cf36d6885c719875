"""How good refined maps are: every method on every case, against exact truth."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import groupby
from time import perf_counter
from typing import Any

from stereomend.bench.machine import Machine, this_machine
from stereomend.bench.quality_cases import ALL_CASES, ONE_OF_EACH, SEEDS_PER_BASE, QualityCase, plan_cases
from stereomend.bench.quality_methods import Method, methods_of
from stereomend.bench.quality_scores import Scored, score_map
from stereomend.bench.quality_summary import Summary, summarise
from stereomend.errors import InvalidParameter
from stereomend.refinement import PRESETS

LARGEST_BASE = 1_000_000
MOST_CASES = SEEDS_PER_BASE

Progress = Callable[[int, int], None]
"""Told before each case how many are done, and of how many."""


@dataclass(frozen=True)
class QualityPlan:
    """What to refine, and with what."""

    seed: int = 0
    """Base of all seeds: another one gives other phantoms and other damage."""
    scenes: int = ALL_CASES
    presets: tuple[str, ...] = tuple(PRESETS)
    overrides: Mapping[str, Any] = field(default_factory=dict)
    """For all presets, such as {"gdr": {"warps": 10}}."""
    quick: bool = False
    """A quarter of all lengths."""


QUICK = QualityPlan(scenes=ONE_OF_EACH, quick=True)
"""A few seconds: whether it works, not how good."""


@dataclass(frozen=True)
class QualityReport:
    """All figures of one run."""

    machine: Machine
    plan: QualityPlan
    seconds: float
    """How long the run took, phantoms included."""
    summaries: list[Summary]
    scored: list[Scored]


def quality_plan_of(
    given: Mapping[str, Any], overrides: Mapping[str, Any], quick: bool = False
) -> QualityPlan:
    """Complete what a person gave: `seed`, `scenes` and `preset` (several).

    Raises:
        InvalidParameter: a number is out of range.
    """
    plan = QUICK if quick else QualityPlan()
    plan = replace(
        plan,
        seed=given.get("seed", plan.seed),
        scenes=given.get("scenes", plan.scenes),
        presets=tuple(given.get("preset", plan.presets)),
        overrides=overrides,
    )
    if not 0 <= plan.seed <= LARGEST_BASE:
        raise InvalidParameter(f"--seed {plan.seed}: expected 0 to {LARGEST_BASE}")
    if not 1 <= plan.scenes <= MOST_CASES:
        raise InvalidParameter(f"--scenes {plan.scenes}: expected 1 to {MOST_CASES}")
    return plan


def run_quality(plan: QualityPlan, progress: Progress) -> QualityReport:
    """Refine and score all cases.

    Raises:
        InvalidParameter: a preset is unknown, or an override unknown or out of range.
        BackendUnavailable: no backend works on this machine.
    """
    began = perf_counter()
    methods = methods_of(plan.presets, plan.overrides)
    cases = plan_cases(plan.seed, plan.scenes, plan.quick)
    scored = list(_scored(cases, methods, progress))
    summaries = summarise(scored)
    return QualityReport(this_machine(), plan, perf_counter() - began, summaries, scored)


def _scored(cases: list[QualityCase], methods: Mapping[str, Method], progress: Progress) -> Iterator[Scored]:
    done = 0
    for _, same_phantom in groupby(cases, key=lambda case: case.seed):
        group = list(same_phantom)
        progress(done, len(cases))
        phantom = group[0].phantom()
        for case in group:
            upload = case.upload(phantom)
            for name, method in methods.items():
                began = perf_counter()
                refined = method(phantom.pair, upload)
                yield score_map(case, name, refined, phantom, 1e3 * (perf_counter() - began))
        done += len(group)
    progress(done, len(cases))


def quality_as_json(report: QualityReport) -> str:
    """All figures as a JSON object."""
    return json.dumps(asdict(report), indent=1) + "\n"
