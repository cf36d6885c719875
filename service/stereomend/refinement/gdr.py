"""Global disparity refinement: the coarse-to-fine driver around a backend's solver."""

from __future__ import annotations

from stereomend.refinement.backends import Backend, Plane
from stereomend.refinement.params import GdrParams
from stereomend.refinement.pyramid import enlarge_disparity, level_sizes
from stereomend.refinement.scene import Scene


def refine_globally(scene: Scene, prior: Plane, params: GdrParams, backend: Backend) -> Plane:
    """Minimise `lambda sum_k (D_k(x - u, right) - D_k(x, left))^2 + |grad u|_eps` from `prior`, (H, W) px.

    The prior starts the coarsest level; each finer level starts from the enlarged result of the one before.
    Eq. 9 to 14 of Yang, Simon, Linte, 2023.
    """
    pyramid = [(scene.left, scene.right, prior)]
    for size in level_sizes(scene.size, params.levels)[1:]:
        left, right, finer = pyramid[-1]
        ratio = finer.dtype.type(size[1] / finer.shape[1])
        pyramid.append(
            (backend.shrink(left, size), backend.shrink(right, size), backend.shrink(finer, size) * ratio)
        )
    u = pyramid[-1][2]
    for left, right, _ in reversed(pyramid):
        u = enlarge_disparity(u, (left.shape[0], left.shape[1]), backend)
        u = backend.solve(left, right, u, params)
    return u
