"""`stereomend evaluate`: from what a person gives to a report."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from stereomend.evaluation.datasets import find_frames
from stereomend.evaluation.files import Reader
from stereomend.evaluation.frame import Frame
from stereomend.evaluation.pictures import Gallery
from stereomend.evaluation.predictions import find_methods
from stereomend.evaluation.report import Report
from stereomend.evaluation.run import Maps, Plan, evaluate, plan_variants
from stereomend.refinement import PRESETS, select_backend
from stereomend.settings import load_settings


@dataclass(frozen=True)
class Task:
    """What a person asked for."""

    dataset: str
    root: Path
    predictions: Path
    max_pixels: int
    presets: Sequence[str] = tuple(PRESETS)
    stages: Sequence[Sequence[str]] = ()
    """One entry per variant of each preset; empty: LDR and GDR."""
    backend: str = "auto"
    pictures: int = 8
    """The most frames that the page shows."""


def task_of(options: argparse.Namespace) -> Task:
    """Take parsed arguments (raises ConfigurationError where the settings are wrong)."""
    return Task(
        options.dataset,
        options.root,
        options.predictions,
        load_settings().max_pixels,
        tuple(options.presets or PRESETS),
        [[part.strip() for part in text.split(",")] for text in options.stages or ()],
        options.backend,
        options.pictures,
    )


def run_task(task: Task) -> tuple[Report, Gallery]:
    """Find everything, then evaluate; the progress goes to a terminal on stderr.

    Raises:
        InputError: a preset, stage, dataset or file cannot be used.
        BackendUnavailable: the backend does not work on this machine.
    """
    variants = plan_variants(task.presets, task.stages)
    entries = find_frames(task.dataset, task.root, task.max_pixels)
    methods = find_methods(task.predictions, [entry.name for entry in entries])
    plan = Plan(entries, methods, variants, select_backend(task.backend), Reader(task.max_pixels))
    gallery, progress = Gallery(task.pictures), _Progress(len(entries) * len(methods))

    def watch(name: str, method: str, frame: Frame, maps: Maps) -> None:
        gallery.show(name, method, frame, maps)
        progress.step(f"{name}, {method}")

    try:
        rows = list(evaluate(plan, watch))
    finally:
        progress.end()
    return Report(f"Evaluation on {task.dataset}", _notes(plan), rows), gallery


def _notes(plan: Plan) -> list[str]:
    frames, methods = len(plan.entries), len(plan.methods)
    made = f"stereomend {version('stereomend')}, backend {plan.backend.name}, kernels {plan.backend.kernel}"
    return [f"{frames} frame{'s'[: frames != 1]}, {methods} method{'s'[: methods != 1]}; {made}."]


class _Progress:
    """One line on stderr that is written over; nothing where that is no terminal."""

    def __init__(self, total: int) -> None:
        self._total, self._done, self._shown = total, 0, sys.stderr.isatty()

    def step(self, text: str) -> None:
        self._done += 1
        if self._shown:
            print(f"\r\033[K{self._done}/{self._total}  {text[:60]}", end="", file=sys.stderr, flush=True)

    def end(self) -> None:
        if self._shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
