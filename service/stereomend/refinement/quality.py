"""What can be said of a result without ground truth: provenance, residuals, warnings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Provenance
from stereomend.refinement.backends import Backend, Plane, Reading
from stereomend.refinement.pyramid import Sparse
from stereomend.refinement.scene import Scene

_CLEARLY_BETTER = 0.75  # a residual this much smaller is no chance
_PERHAPS_BETTER = 0.95  # of fewer rows; then the others are read too
_FEW = 0.1  # a mean over fewer of the valid pixels says little
_ENOUGH = 60_000  # pixels, for a mean that is off by 1 or 2 % from that of all
_SCALES = (1 / 256, 1 / 16, 1 / 4, 1 / 2, 2, 4, 16, 256)
_OFFSETS = (-4, -2, -1, 1, 2, 4)  # rows at working size
_BANDS = 5
_BAND_ROWS = 8  # of sampled bands, the outer two are described with rows of another band


def shares_of(counts: Sequence[int]) -> dict[str, float]:
    """The share of each kind of pixel, from their numbers in the order of `Provenance`; they sum to 1."""
    total = sum(counts)
    return {kind.name.lower(): count / total for kind, count in zip(Provenance, counts, strict=True)}


def sampled(sparse: Sparse) -> Sparse:
    """As many bands of rows, evenly apart, as hold enough pixels for a mean."""
    height, width = sparse.valid.shape
    bands = np.arange(height) // _BAND_ROWS
    apart = max(1, round(height * width / _ENOUGH))
    return Sparse(sparse.u, sparse.valid & (bands % apart == 0)[:, None])


def residuals(left: Plane, readings: Sequence[Reading], backend: Backend) -> list[float | None]:
    """Mean distance of the descriptors, 0 to 2, over valid observed pixels; None where these are few."""
    return [
        mean if count and count >= _FEW * np.count_nonzero(reading.valid) else None
        for reading, (mean, count) in zip(readings, backend.mismatch(left, readings), strict=True)
    ]


def warnings_of(scene: Scene, initial: Sparse, refined: Sparse, backend: Backend) -> Iterator[str]:
    """Name what looks wrong with the input: where another reading of it explains the pair clearly better."""
    bands = _sample_bands(scene.size[0])
    # The one in the middle shows that most inputs are sound.
    found = _readings(scene, initial, refined, backend, bands[[_BANDS // 2]])
    if any(now is None or _doubted(now, others, _PERHAPS_BETTER) for now, others in found.values()):
        found = _readings(scene, initial, refined, backend, bands)
        yield from (name for name, read in found.items() if _doubted(*read, _CLEARLY_BETTER))


def _readings(
    scene: Scene, initial: Sparse, refined: Sparse, backend: Backend, bands: npt.NDArray[np.intp]
) -> dict[str, tuple[float | None, list[float | None]]]:
    """By warning: the residual of what it is about as it is, and those of other readings."""
    rows = np.unique(bands)
    initial, refined = _only(initial, rows), _only(refined, rows)
    moved = [Reading(_below(scene.right, rows, by), *refined) for by in (0, *_OFFSETS)]
    right = moved[0].right
    scaled = [Reading(right, initial.u * scale, initial.valid) for scale in (1, -1, *_SCALES)]
    found = residuals(scene.left[rows], (*moved, *scaled), backend)
    (as_moved, *others), (as_scaled, mirrored, *rescaled) = found[: len(moved)], found[len(moved) :]
    return {
        "not-rectified": (as_moved, others),
        "views-swapped": (as_scaled, [mirrored]),
        "scale-suspect": (as_scaled, rescaled),
    }


def _doubted(now: float | None, others: Iterable[float | None], share: float) -> bool:
    """Whether one of the other readings leaves less than this share of the residual."""
    return now is not None and any(other is not None and other < share * now for other in others)


def _sample_bands(height: int) -> npt.NDArray[np.intp]:
    """Some bands of neighbouring rows, one per row: enough for a mean, and far less work than all."""
    tops = np.linspace(0, max(0, height - _BAND_ROWS), _BANDS).astype(np.intp)
    rows: npt.NDArray[np.intp] = np.minimum(tops[:, None] + np.arange(_BAND_ROWS), height - 1)
    return rows


def _below(image: Plane, rows: npt.NDArray[np.intp], offset: int) -> Plane:
    """The sampled rows of an image, each taken `offset` further down."""
    return image[np.clip(rows + offset, 0, image.shape[0] - 1)]


def _only(sparse: Sparse, rows: npt.NDArray[np.intp]) -> Sparse:
    return Sparse(sparse.u[rows], sparse.valid[rows])
