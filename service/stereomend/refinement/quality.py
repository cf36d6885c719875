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


def unobserved(disparity: Plane) -> Mask:
    """Pixels (H, W) not seen in the right image: outside of it, or hidden.

    Hidden: a pixel further right in the row lands at least 1 px left of this one's column there.
    """
    width = disparity.shape[1]
    column = np.arange(width) - disparity
    nearest_left = np.minimum.accumulate(column[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(disparity.shape, np.bool_)
    hidden[:, :-1] = nearest_left[:, 1:] <= column[:, :-1] - 1
    result: Mask = hidden | (column < 0) | (column > width - 1)
    return result


def provenance_of(disparity: Plane, origin: Origin) -> npt.NDArray[np.uint8]:
    """Values of `Provenance` for a returned map, (H, W)."""
    moved = np.abs(disparity - origin.initial.u) > KEPT_WITHIN
    provenance = np.where(moved, np.uint8(Provenance.REFINED), np.uint8(Provenance.KEPT))
    provenance[~origin.kept] = Provenance.FILLED
    provenance[unobserved(disparity)] = Provenance.UNOBSERVED
    return provenance


def shares_of(provenance: npt.NDArray[np.uint8]) -> dict[str, float]:
    """The share of each kind of pixel; they sum to 1."""
    counts = np.bincount(provenance.ravel(), minlength=len(Provenance)) / provenance.size
    return {kind.name.lower(): float(counts[kind]) for kind in Provenance}


def residual(scene: Scene, sparse: Sparse, backend: Backend) -> float | None:
    """Mean distance of the descriptors, 0 to 2, over valid observed pixels; None where these are few."""
    seen = sparse.valid & ~unobserved(sparse.u)
    if not seen.any() or seen.sum() < _FEW * sparse.valid.sum():
        return None
    return float(backend.distance(scene.left, scene.right, sparse.u)[seen].mean(dtype=np.float64))


def warnings_of(scene: Scene, initial: Sparse, refined: Sparse, backend: Backend) -> Iterator[str]:
    """Name what looks wrong with the input: where another reading of it explains the pair clearly better."""
    rows = _sample_rows(scene.size[0])
    scene_now, initial, refined = _rows_of(scene, rows), _only(initial, rows), _only(refined, rows)

    def doubted(now: Sparse, others: Iterable[tuple[Scene, Sparse]]) -> bool:
        residuals = [residual(*reading, backend) for reading in ((scene_now, now), *others)]
        if residuals[0] is None:
            return False
        return min(other for other in residuals if other is not None) < _CLEARLY_BETTER * residuals[0]

    if doubted(refined, ((_rows_of(scene, rows, offset), refined) for offset in _OFFSETS)):
        yield "not-rectified"
    if doubted(initial, [(scene_now, Sparse(-initial.u, initial.valid))]):
        yield "views-swapped"
    if doubted(initial, ((scene_now, Sparse(initial.u * scale, initial.valid)) for scale in _SCALES)):
        yield "scale-suspect"


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
