"""How well the pair itself speaks for a map: agreement of descriptors, and confidence made from it.

R numbers are the equations of `docs/robust.md`.
"""

from __future__ import annotations

from collections.abc import Sequence

from stereomend.refinement.backends import Backend, Plane, Usable
from stereomend.refinement.pyramid import Sparse
from stereomend.refinement.scene import Scene
from stereomend.refinement.stage_params import GdrParams, LdrParams


def evidence_confidence(sparse: Sparse, scene: Scene, params: LdrParams, backend: Backend) -> Plane:
    """c, (H, W) in [0, 1] (R1): evidence, smoothness, and none where hidden, glinting or a speckle."""
    usable = Usable(sparse.valid, scene.matte)
    return backend.evidence_confidence(scene.left, scene.right, sparse.u, usable, params)


def edge_weights(channels: Sequence[Plane], params: GdrParams, backend: Backend) -> Plane | None:
    """w, (H, W) over 0 to 1, weight of the smoothness (R4), from grey or R, G, B of 0 to 255; None: 1.

    The largest channel counts: at the border of an instrument, brightness alone may hardly change.
    """
    return None if params.edge_level is None else backend.edge_weights(channels, params)
