"""Global disparity refinement: the coarse-to-fine driver around a backend's solver."""

from __future__ import annotations

from typing import NamedTuple

from stereomend.refinement.backends import Backend, Plane, Size
from stereomend.refinement.params import GdrParams
from stereomend.refinement.pyramid import enlarge_disparity, level_sizes
from stereomend.refinement.scene import Scene


class _Level(NamedTuple):
    """Both images, where to start and the weight of the data term, each (H, W) at the level's size."""

    left: Plane
    right: Plane
    prior: Plane
    weight: Plane | None


def refine_globally(scene: Scene, prior: Plane, params: GdrParams, backend: Backend) -> Plane:
    """Minimise `lambda sum_k (D_k(x - u, right) - D_k(x, left))^2 + |grad u|_eps` from `prior`, (H, W) px.

    The prior starts the coarsest level; each finer level starts from the enlarged result of the one before.
    What is not part of the scene has no data term: there the map continues smoothly.
    Eq. 9 to 14 of Yang, Simon, Linte, 2023.
    """
    pyramid = [_Level(scene.left, scene.right, prior, scene.weight)]
    for size in level_sizes(scene.size, params.levels)[1:]:
        pyramid.append(_coarser(pyramid[-1], size, backend))
    u = pyramid[-1].prior
    for level in reversed(pyramid):
        u = enlarge_disparity(u, (level.left.shape[0], level.left.shape[1]), backend)
        u = backend.solve(level.left, level.right, u, params, level.weight)
    return u


def _coarser(level: _Level, size: Size, backend: Backend) -> _Level:
    left, right, prior = (backend.shrink(plane, size) for plane in (level.left, level.right, level.prior))
    weight = None if level.weight is None else backend.shrink(level.weight, size)
    return _Level(left, right, prior * prior.dtype.type(size[1] / level.prior.shape[1]), weight)
