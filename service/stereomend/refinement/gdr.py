"""Global disparity refinement: what it is given of the scene and of the local stage's map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stereomend.refinement.backends import Backend, Plane, Problem, Solved, Tick
from stereomend.refinement.evidence import edge_weights
from stereomend.refinement.ldr import Local
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
    trust = confidence * confidence.dtype.type(params.data_weight * params.prior_weight)
    if local.occluded is not None:
        np.copyto(trust, params.data_weight * params.fill_weight, where=local.occluded)
    return Prior(local.u, trust)


def with_edges(scene: Scene, params: GdrParams, backend: Backend) -> Scene:
    """The scene with the weights of the smoothness that `params` ask for (R4)."""
    return scene._replace(edge=edge_weights(scene.channels, params, backend))


def refine_globally(
    scene: Scene, prior: Prior, params: GdrParams, backend: Backend, tick: Tick | None = None
) -> Solved:
    """Minimise `lambda sum_k (D_k(x - u, right) - D_k(x, left))^2 + w |grad u|_eps + k |u - prior|`, px.

    The prior starts the coarsest level; each finer level starts from the enlarged result of the one before.
    What is not part of the scene has no data term: there the map continues smoothly.
    Eq. 9 to 14 of Yang, Simon, Linte, 2023; w, k and what else `params` may ask for: R3 to R6.
    """
    problem = Problem(scene.left, scene.right, scene.channels, prior.u, prior.trust, scene.edge, scene.weight)
    return backend.globally(problem, params, tick)
