"""What is refined: a phantom whose disparity is broken as networks break it, at working size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from stereomend.bench.clock import Timed
from stereomend.disparity import DisparityMap, FloatMap, StereoPair
from stereomend.phantom import Phantom, break_disparity, make_phantom
from stereomend.refinement import Backend, parse_params, select_backend
from stereomend.refinement.params import RefineParams
from stereomend.refinement.pipeline import Begun, globally, locally, start_from
from stereomend.refinement.pyramid import working_size
from stereomend.refinement.scene import make_scene
from stereomend.refinement.stage_params import GdrParams

SEED = 7
SOLVED = {"preset": "released"}
"""Whose working size and base map single solves are timed with."""

WxH = tuple[int, int]
"""Width and height in pixels."""


class Setup(NamedTuple):
    """One configuration apart from its preset; `size` is the input's."""

    backend: str
    size: WxH
    threads: int


class Case(NamedTuple):
    """One configuration, ready to run."""

    backend: Backend
    threads: int
    pair: StereoPair
    upload: DisparityMap


def worked_size(size: WxH, params: RefineParams) -> WxH:
    """The size that an input of `size` is worked at."""
    height, width = working_size((size[1], size[0]), params.processing_scale)
    return width, height


def begin(case: Case, params: RefineParams) -> Begun:
    """Bring a case to the size that `params` ask for."""
    width, height = worked_size((case.pair.shape[1], case.pair.shape[0]), params)
    scene = make_scene(case.pair, (height, width), params.ldr, case.backend)
    return Begun(scene, start_from("upload", case.upload, scene, case.pair, case.backend))


def broken_phantom(size: WxH) -> tuple[Phantom, FloatMap]:
    """The scene of all benchmarks, and its broken disparity, (H, W) px, 0 where unknown."""
    phantom = make_phantom(SEED, *size)
    return phantom, break_disparity(phantom, SEED).values


def make_cases(setups: Sequence[Setup]) -> dict[Setup, Case]:
    """Prepare all configurations (raises BackendUnavailable)."""
    cases: dict[Setup, Case] = {}
    for size in dict.fromkeys(setup.size for setup in setups):
        phantom, disparity = broken_phantom(size)
        upload = DisparityMap.from_array(disparity)
        for setup in setups:
            if setup.size == size:
                backend = select_backend(setup.backend, setup.threads)
                cases[setup] = Case(backend, setup.threads, phantom.pair, upload)
    return cases


def local_job(case: Case, params: RefineParams) -> Timed:
    """LDR as the pipeline runs it: confidence, then the search."""
    return Timed(partial(locally, begin(case, params), params, case.backend), case.threads)


def global_job(case: Case, params: RefineParams) -> Timed:
    """GDR as the pipeline runs it, after LDR: all levels, and the choice between its map and the upload."""
    begun = begin(case, params)
    trusted = locally(begun, params, case.backend)
    return Timed(partial(globally, begun, trusted, params, case.backend), case.threads)


def solve_job(case: Case, iterations: int) -> Timed:
    """One warp at the finest level with so many primal-dual iterations."""
    params, solver = parse_params(SOLVED), GdrParams(warps=1, iterations=iterations)
    begun = begin(case, params)
    prior = locally(begun, params, case.backend).local.u
    left, right = begun.scene.left, begun.scene.right
    solve: Callable[[], object] = partial(case.backend.solve, left, right, prior, solver)
    return Timed(solve, case.threads)
