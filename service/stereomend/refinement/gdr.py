"""Global disparity refinement: the coarse-to-fine driver around a backend's solver."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from stereomend.refinement.backends import Backend, Guide, Plane, ReuseRule, Size
from stereomend.refinement.evidence import edge_weights
from stereomend.refinement.ldr import Local
from stereomend.refinement.pyramid import enlarge_disparity, level_sizes
from stereomend.refinement.scene import Scene
from stereomend.refinement.stage_params import GdrParams


class Prior(NamedTuple):
    """Where GDR starts, (H, W) px at working size, and the weight of |u - prior| (None: it only starts)."""

    u: Plane
    trust: Plane | None = None


def prior_of(local: Local, confidence: Plane, params: GdrParams) -> Prior:
    """LDR's map, trusted by its confidence, (H, W) in [0, 1], in occlusions by a weight of their own (R3)."""
    if params.prior_weight == params.fill_weight == 0:
        return Prior(local.u)
    trust = confidence * confidence.dtype.type(params.prior_weight)
    if local.occluded is not None:
        np.copyto(trust, params.fill_weight, where=local.occluded)
    return Prior(local.u, trust)


class _Level(NamedTuple):
    """Images, the left one's channels and edges, start, prior and weight of the data term, at one size."""

    left: Plane
    right: Plane
    channels: tuple[Plane, ...]
    edge: Plane | None
    start: Plane
    prior: Prior
    weight: Plane | None

    @property
    def size(self) -> Size:
        return self.left.shape[0], self.left.shape[1]


def with_edges(scene: Scene, params: GdrParams, backend: Backend) -> Scene:
    """The scene with the weights of the smoothness that `params` ask for (R4)."""
    return scene._replace(edge=edge_weights(scene.channels, params, backend))


def refine_globally(scene: Scene, prior: Prior, params: GdrParams, backend: Backend) -> Plane:
    """Minimise `lambda sum_k (D_k(x - u, right) - D_k(x, left))^2 + w |grad u|_eps + k |u - prior|`, px.

    The prior starts the coarsest level; each finer level starts from the enlarged result of the one before.
    What is not part of the scene has no data term: there the map continues smoothly.
    Eq. 9 to 14 of Yang, Simon, Linte, 2023; w, k and what else `params` may ask for: R3 to R6.
    """
    pyramid = [_Level(scene.left, scene.right, scene.channels, scene.edge, prior.u, prior, scene.weight)]
    for _ in level_sizes(scene.size, params.levels)[1:]:
        pyramid.append(_coarser(pyramid[-1], params, backend))
    u = _solve(pyramid[-1], pyramid[-1].start, _schedule(params, len(pyramid) == 1), backend)
    for level in pyramid[-2::-1]:
        finest, u = level is pyramid[0], enlarge_disparity(u, level.size, backend)
        u = u if finest else _better(level, u, params, backend)
        u = _solve(level, u, _schedule(params, finest), backend)
    return u


def _schedule(params: GdrParams, finest: bool) -> GdrParams:
    if finest:
        return params
    return params.model_copy(
        update={
            "warps": params.coarse_warps or params.warps,
            "iterations": params.coarse_iterations or params.iterations,
        }
    )


def _solve(level: _Level, u: Plane, params: GdrParams, backend: Backend) -> Plane:
    trust = level.prior.trust
    guide = Guide(level.edge, None if trust is None else level.prior.u, trust)
    return backend.solve(level.left, level.right, u, params, weight=level.weight, guide=guide)


def _better(level: _Level, u: Plane, params: GdrParams, backend: Backend) -> Plane:
    """The prior where the pair speaks for it far more than for what coarser levels found (R6)."""
    if params.reuse_margin is None:
        return u
    return backend.better(level.left, level.right, u, level.prior.u, ReuseRule(params.reuse_margin))


def _coarser(level: _Level, params: GdrParams, backend: Backend) -> _Level:
    """The next level, of half the size."""
    whole = [level.left, level.right, level.start, *level.channels]
    whole += [] if level.weight is None else [level.weight]
    left, right, start, *others = backend.halve(whole)
    channels = tuple(others[: len(level.channels)])
    weight = None if level.weight is None else others[-1]
    # Of the shrunken colours: the mean of weights would keep edges that the level does not show.
    edge = edge_weights(channels, params, backend)
    start = start * _ratio(start, level.start)
    return _Level(left, right, channels, edge, start, _coarser_prior(level.prior, start, backend), weight)


def _coarser_prior(prior: Prior, start: Plane, backend: Backend) -> Prior:
    """Averaged with its trust; without any it is what the coarser level starts with."""
    return Prior(start) if prior.trust is None else Prior(*backend.halve_weighed(prior.u, prior.trust))


def _ratio(smaller: Plane, larger: Plane) -> np.floating[Any]:
    ratio: np.floating[Any] = smaller.dtype.type(smaller.shape[1] / larger.shape[1])
    return ratio
