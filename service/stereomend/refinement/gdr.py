"""Global disparity refinement: the coarse-to-fine driver around a backend's solver."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stereomend.refinement.backends import Backend, Guide, Plane, Size
from stereomend.refinement.evidence import edge_weights
from stereomend.refinement.ldr import Local
from stereomend.refinement.pyramid import enlarge_disparity, level_sizes
from stereomend.refinement.scene import Scene
from stereomend.refinement.stage_params import GdrParams

_DIFFERENT = 0.5  # px; nearer readings compete in the solver itself
_LEAST_EVIDENCE = 0.3  # a prior that the pair contradicts replaces nothing


class Prior(NamedTuple):
    """Where GDR starts, (H, W) px at working size, and the weight of |u - prior| (None: it only starts)."""

    u: Plane
    trust: Plane | None = None


def prior_of(local: Local, confidence: Plane, params: GdrParams) -> Prior:
    """LDR's map, trusted by its confidence, (H, W) in [0, 1], in occlusions by a weight of their own (R3)."""
    if params.prior_weight == params.fill_weight == 0:
        return Prior(local.u)
    trust = params.prior_weight * confidence
    if local.occluded is not None:
        trust = np.where(local.occluded, params.fill_weight, trust)
    return Prior(local.u, trust.astype(local.u.dtype, copy=False))


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
    for size in level_sizes(scene.size, params.levels)[1:]:
        pyramid.append(_coarser(pyramid[-1], size, params, backend))
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
    found, claimed = backend.evidence(level.left, level.right, (u, level.prior.u))
    different = (np.abs(level.prior.u - u) > _DIFFERENT) & ~backend.unobserved(level.prior.u)
    stronger = claimed > np.maximum(found + params.reuse_margin, _LEAST_EVIDENCE)
    return np.where(different & stronger, level.prior.u, u)


def _coarser(level: _Level, size: Size, params: GdrParams, backend: Backend) -> _Level:
    left, right, start = (backend.shrink(plane, size) for plane in (level.left, level.right, level.start))
    channels = tuple(backend.shrink(channel, size) for channel in level.channels)
    ratio = start.dtype.type(size[1] / level.size[1])
    weight = None if level.weight is None else backend.shrink(level.weight, size)
    # Of the shrunken colours: the mean of weights would keep edges that the level does not show.
    edge, prior = edge_weights(channels, params, backend), _coarser_prior(level.prior, size, backend)
    return _Level(left, right, channels, edge, start * ratio, prior, weight)


def _coarser_prior(prior: Prior, size: Size, backend: Backend) -> Prior:
    """The area mean weighed by trust, so that what is not trusted does not smear over what is."""
    ratio = prior.u.dtype.type(size[1] / prior.u.shape[1])
    if prior.trust is None:
        return Prior(backend.shrink(prior.u, size) * ratio)
    share = prior.trust + prior.u.dtype.type(1e-6)
    u = backend.shrink(prior.u * share, size) / backend.shrink(share, size)
    return Prior(u * ratio, backend.shrink(prior.trust, size))
