"""From coarse to fine: the levels of GDR, and how each starts from the one before.

`coarse_to_fine` is what backends on the CPU share; one with a memory of its own does the same there.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from stereomend.refinement.backends.base import Backend
from stereomend.refinement.backends.data import Guide, Plane, Problem, ReuseRule, Size, Tick
from stereomend.refinement.stage_params import GdrParams


def level_sizes(size: Size, params: GdrParams) -> list[Size]:
    """Sizes of the levels, finest first, each half of the one before, rounded up."""
    sizes = [size]
    while len(sizes) < params.levels:
        height, width = ((side + 1) // 2 for side in sizes[-1])
        if min(height, width) < params.least_side_px:
            break
        sizes.append((height, width))
    return sizes


def enlarge_disparity(u: Plane, size: Size, backend: Backend) -> Plane:
    """Enlarge bilinearly, times the width ratio: the values are pixels of the new size."""
    enlarged = backend.enlarge(u, size)
    return enlarged * enlarged.dtype.type(size[1] / u.shape[1])


def schedule(params: GdrParams, finest: bool) -> GdrParams:
    """The parameters of one level: coarser ones may have warps and iterations of their own."""
    if finest:
        return params
    return params.model_copy(
        update={
            "warps": params.coarse_warps or params.warps,
            "iterations": params.coarse_iterations or params.iterations,
        }
    )


class _Level(NamedTuple):
    problem: Problem
    start: Plane
    """The prior averaged without its trust."""


def warps_of(size: Size, params: GdrParams) -> int:
    """The warps of all levels together."""
    levels = range(len(level_sizes(size, params)))
    return sum(schedule(params, level == 0).warps for level in levels)


def coarse_to_fine(problem: Problem, params: GdrParams, backend: Backend, tick: Tick | None = None) -> Plane:
    """Solve the coarsest level from the prior, each finer one from the enlarged result; (H, W) px."""
    pyramid = [_Level(problem, problem.prior)]
    for _ in level_sizes(problem.size, params)[1:]:
        pyramid.append(_coarser(pyramid[-1], params, backend))
    solve = partial(_solve, backend=backend, tick=tick)
    u = solve(pyramid[-1].problem, pyramid[-1].start, schedule(params, len(pyramid) == 1))
    for level in pyramid[-2::-1]:
        finest, u = level is pyramid[0], enlarge_disparity(u, level.problem.size, backend)
        u = u if finest else _better(level.problem, u, params, backend)
        u = solve(level.problem, u, schedule(params, finest))
    return u


def _solve(problem: Problem, u: Plane, params: GdrParams, backend: Backend, tick: Tick | None) -> Plane:
    guide = Guide(problem.edge, None if problem.trust is None else problem.prior, problem.trust)
    return backend.solve(
        problem.left, problem.right, u, params, weight=problem.weight, guide=guide, tick=tick
    )


def _better(problem: Problem, u: Plane, params: GdrParams, backend: Backend) -> Plane:
    """The prior where the pair speaks for it far more than for what coarser levels found (R6)."""
    if params.reuse_margin is None:
        return u
    return backend.better(problem.left, problem.right, u, problem.prior, ReuseRule(params.reuse_margin))


def _coarser(level: _Level, params: GdrParams, backend: Backend) -> _Level:
    """The next level, of half the size."""
    problem = level.problem
    whole = [problem.left, problem.right, level.start, *problem.channels]
    whole += [] if problem.weight is None else [problem.weight]
    left, right, start, *others = backend.halve(whole)
    channels = tuple(others[: len(problem.channels)])
    weight = None if problem.weight is None else others[-1]
    # Of the shrunken colours: the mean of weights would keep edges that the level does not show.
    edge = None if params.edge_level is None else backend.edge_weights(channels, params)
    start = start * _ratio(start, level.start)
    # Averaged with its trust; without any the prior is what the coarser level starts with.
    prior, trust = start, None
    if problem.trust is not None:
        prior, trust = backend.halve_weighed(problem.prior, problem.trust)
    return _Level(Problem(left, right, channels, prior, trust, edge, weight), start)


def _ratio(smaller: Plane, larger: Plane) -> np.floating[Any]:
    ratio: np.floating[Any] = smaller.dtype.type(smaller.shape[1] / larger.shape[1])
    return ratio
