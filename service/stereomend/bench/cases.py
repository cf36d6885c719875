"""What is refined: a phantom whose disparity is broken as networks break it, at working size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from stereomend.bench.clock import Timed
from stereomend.disparity import FloatMap
from stereomend.phantom import Phantom, break_disparity, make_phantom
from stereomend.refinement import Backend, parse_params, select_backend
from stereomend.refinement.gdr import refine_globally
from stereomend.refinement.ldr import Local, confidence_of, refine_locally
from stereomend.refinement.params import GdrParams, RefineParams
from stereomend.refinement.pyramid import Sparse, shrink_disparity, working_size
from stereomend.refinement.scene import Scene, make_scene

SEED = 7

WxH = tuple[int, int]
"""Width and height in pixels."""


class Setup(NamedTuple):
    """One configuration apart from its preset; `size` is the input's."""

    backend: str
    size: WxH
    threads: int


class Case(NamedTuple):
    """One configuration, ready to run; the scene and the disparity are at working size."""

    backend: Backend
    threads: int
    scene: Scene
    initial: Sparse


def worked_size(size: WxH) -> WxH:
    """The size that an input of `size` is worked at with the default `processing_scale`."""
    height, width = working_size((size[1], size[0]), parse_params().processing_scale)
    return width, height


def broken_phantom(size: WxH) -> tuple[Phantom, FloatMap]:
    """The scene of all benchmarks, and its broken disparity, (H, W) px, 0 where unknown."""
    phantom = make_phantom(SEED, *size)
    return phantom, break_disparity(phantom, SEED).values


def make_cases(setups: Sequence[Setup]) -> dict[Setup, Case]:
    """Prepare all configurations (raises BackendUnavailable)."""
    cases: dict[Setup, Case] = {}
    for size in dict.fromkeys(setup.size for setup in setups):
        phantom, disparity = broken_phantom(size)
        sparse = Sparse(disparity, disparity > 0)
        for setup in setups:
            if setup.size == size:
                backend = select_backend(setup.backend, setup.threads)
                width, height = worked_size(size)
                scene = make_scene(phantom.pair, (height, width), parse_params().ldr, backend)
                initial = shrink_disparity(sparse, scene.size, backend)
                cases[setup] = Case(backend, setup.threads, scene, initial)
    return cases


def local_job(case: Case, params: RefineParams) -> Timed:
    """LDR as the pipeline runs it: confidence, then the search."""
    return Timed(partial(refined_locally, case, params), case.threads)


def global_job(case: Case, params: RefineParams) -> Timed:
    """GDR as the pipeline runs it, after LDR: all levels."""
    prior = refined_locally(case, params).u
    return Timed(partial(refine_globally, case.scene, prior, params.gdr, case.backend), case.threads)


def solve_job(case: Case, iterations: int) -> Timed:
    """One warp at the finest level with so many primal-dual iterations."""
    params = GdrParams(warps=1, iterations=iterations)
    prior = refined_locally(case, parse_params()).u
    left, right = case.scene.left, case.scene.right
    solve: Callable[[], object] = partial(case.backend.solve, left, right, prior, params)
    return Timed(solve, case.threads)


def refined_locally(case: Case, params: RefineParams) -> Local:
    """LDR of the broken disparity."""
    confidence = confidence_of(case.initial, case.scene, params.ldr, case.backend)
    steps = max(1, round(params.ldr.search_px * params.processing_scale))
    return refine_locally(case.initial, confidence, params.ldr, steps, case.backend)
