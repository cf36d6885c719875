"""What can be said of a result without ground truth: provenance, residuals, warnings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Mask, Provenance
from stereomend.refinement.backends import Backend, Plane
from stereomend.refinement.pyramid import Sparse
from stereomend.refinement.scene import Scene

KEPT_WITHIN = 0.5
"""A pixel this near to its input, in pixels, counts as kept."""

_CLEARLY_BETTER = 0.75  # a residual this much smaller is no chance
_FEW = 0.1  # a mean over fewer of the valid pixels says little
_SCALES = (1 / 256, 1 / 16, 1 / 4, 1 / 2, 2, 4, 16, 256)
_OFFSETS = (-4, -2, -1, 1, 2, 4)  # rows at working size
_BANDS = 8
_BAND_ROWS = 8  # the outer two are described with rows of another band


class Origin(NamedTuple):
    """What a returned map came from, (H, W) at input size."""

    initial: Sparse
    kept: Mask
    """Known, and not replaced by the local refinement."""
    mask: Mask | None = None
    """Part of the scene; None: all."""


def provenance_of(disparity: Plane, origin: Origin, backend: Backend) -> npt.NDArray[np.uint8]:
    """Values of `Provenance` for a returned map, (H, W)."""
    moved = np.abs(disparity - origin.initial.u) > KEPT_WITHIN
    unobserved = backend.unobserved(disparity)
    if origin.mask is not None:
        unobserved |= ~origin.mask
    provenance = np.full(disparity.shape, Provenance.KEPT, np.uint8)
    for kind, pixels in (
        (Provenance.REFINED, moved),
        (Provenance.FILLED, ~origin.kept),
        (Provenance.UNOBSERVED, unobserved),
    ):
        np.maximum(provenance, pixels * np.uint8(kind), out=provenance)
    return provenance


def shares_of(provenance: npt.NDArray[np.uint8]) -> dict[str, float]:
    """The share of each kind of pixel; they sum to 1."""
    counts = {kind: np.count_nonzero(provenance == np.uint8(kind)) for kind in Provenance}
    return {kind.name.lower(): count / provenance.size for kind, count in counts.items()}


def residual(scene: Scene, sparse: Sparse, backend: Backend) -> float | None:
    """Mean distance of the descriptors, 0 to 2, over valid observed pixels; None where these are few."""
    mean, count = backend.mismatch(scene.left, scene.right, sparse.u, sparse.valid)
    return mean if count and count >= _FEW * np.count_nonzero(sparse.valid) else None


def warnings_of(scene: Scene, initial: Sparse, refined: Sparse, backend: Backend) -> Iterator[str]:
    """Name what looks wrong with the input: where another reading of it explains the pair clearly better."""
    rows = _sample_rows(scene.size[0])
    initial, refined = _only(initial, rows), _only(refined, rows)
    scene_now = _rows_of(scene, rows)
    shifted = (residual(_rows_of(scene, rows, by), refined, backend) for by in _OFFSETS)
    if _doubted(residual(scene_now, refined, backend), shifted):
        yield "not-rectified"
    now = residual(scene_now, initial, backend)
    if _doubted(now, [residual(scene_now, Sparse(-initial.u, initial.valid), backend)]):
        yield "views-swapped"
    scaled = (Sparse(initial.u * scale, initial.valid) for scale in _SCALES)
    if _doubted(now, (residual(scene_now, sparse, backend) for sparse in scaled)):
        yield "scale-suspect"


def _doubted(now: float | None, others: Iterable[float | None]) -> bool:
    """Whether one of the other readings leaves a clearly smaller residual; they are asked for one by one."""
    return now is not None and any(other is not None and other < _CLEARLY_BETTER * now for other in others)


def _sample_rows(height: int) -> npt.NDArray[np.intp]:
    """Some bands of neighbouring rows: enough for a mean, and far less work than all."""
    tops = np.linspace(0, max(0, height - _BAND_ROWS), _BANDS).astype(np.intp)
    rows = np.unique(tops[:, None] + np.arange(_BAND_ROWS))
    return rows[rows < height]


def _rows_of(scene: Scene, rows: npt.NDArray[np.intp], offset: int = 0) -> Scene:
    """The sampled rows, those of the right image `offset` further down."""
    shifted = np.clip(rows + offset, 0, scene.size[0] - 1)
    return scene._replace(left=scene.left[rows], right=scene.right[shifted])


def _only(sparse: Sparse, rows: npt.NDArray[np.intp]) -> Sparse:
    return Sparse(sparse.u[rows], sparse.valid[rows])
