"""From working size back to the input's: the result with all that is told about it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from functools import cache
from importlib.metadata import version
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from stereomend.disparity import FloatMap, Mask, RefinementResult, StereoPair
from stereomend.refinement.backends import Backend, Origins, Plane, Reading, Size, Solved
from stereomend.refinement.fusion import Fused, at_input_size
from stereomend.refinement.ldr import Local, confidence_of
from stereomend.refinement.params import Initial, RefineParams
from stereomend.refinement.pyramid import Sparse, enlarge_disparity, enlarge_mask, level_sizes
from stereomend.refinement.quality import residuals, sampled, shares_of, warnings_of
from stereomend.refinement.scene import Scene


class Start(NamedTuple):
    """The initial disparity at both sizes."""

    kind: Initial
    full: Sparse
    working: Sparse


class Trace(NamedTuple):
    """What happened on the way, each plane (H, W) at working size."""

    pair: StereoPair
    scene: Scene
    start: Start
    confidence: Plane
    """Of the initial disparity."""
    local: Local
    solved: Solved | None
    """What GDR made of it; None where it did not run."""
    fused: Fused | None = None
    """The choice between the upload and `refined`; None where there was none."""

    @property
    def refined(self) -> Plane:
        """The last stage's map."""
        return self.local.u if self.solved is None else self.solved.u

    @property
    def outcome(self) -> Plane:
        """The map that is returned."""
        return self.refined if self.fused is None else self.fused.mixed

    @property
    def kept(self) -> Mask:
        """Pixels whose value nothing replaced."""
        return self.local.inliers if self.fused is None else self.local.inliers | self.fused.chosen


class Mended(NamedTuple):
    """The map that is returned, (H, W) px at input size, and what tells of it."""

    disparity: FloatMap
    trace: Trace
    origins: Origins
    timings: dict[str, float]
    """Milliseconds of each stage."""


def finish(trace: Trace, params: RefineParams, backend: Backend, timings: dict[str, float]) -> Mended:
    """Bring the outcome back to input size."""
    began = perf_counter()
    initial, pair = trace.start.full, trace.pair
    origins = Origins(initial, trace.kept, pair.mask)
    disparity = _at_input_size(trace, origins, params, backend)
    return Mended(disparity, trace, origins, timings | {"finish": 1e3 * (perf_counter() - began)})


def describe(
    mended: Mended, params: RefineParams, backend: Backend, confidences: bool = True
) -> RefinementResult:
    """All that is told about a map.

    Without `confidences`, which few answers hold, these are NaN, and the map may be written meanwhile: until
    that is done, one core is left to it.
    """
    began = perf_counter()
    disparity, trace, origins, timings = mended
    pair, valid, outcome = trace.pair, origins.initial.valid, trace.outcome
    refined = Sparse(outcome, trace.scene.shown(outcome > 0))
    planes = _confidences(trace, refined, params, backend) if confidences else _not_asked_for(pair.shape)
    first = backend if confidences else backend.alone
    provenance, counts = first.tell(disparity, origins)
    shares = {"valid_in": np.count_nonzero(valid) / valid.size} | shares_of(counts)
    warnings = list(_warnings(trace, refined, params, first))
    quality = _quality(trace, refined, params, backend) | {"warnings": warnings}
    result = RefinementResult(
        disparity=disparity,
        confidence=planes[0],
        provenance=provenance,
        input_confidence=planes[1],
        depth_mm=_depth(disparity, pair, params),
        timings=timings,
        meta=_meta(trace, params, backend) | {"quality": shares | quality},
    )
    finish = timings["finish"] + 1e3 * (perf_counter() - began)
    return replace(result, timings=timings | {"finish": finish})


def _confidences(
    trace: Trace, refined: Sparse, params: RefineParams, backend: Backend
) -> tuple[FloatMap, FloatMap]:
    """Of the result and of its input."""
    size = trace.pair.shape
    confidence = confidence_of(refined, trace.scene, params.ldr, backend)
    of_input = _enlarged(trace.confidence, size, backend) * trace.start.full.valid
    return _of_the_scene(_enlarged(confidence, size, backend), trace.pair), of_input


def _not_asked_for(size: Size) -> tuple[FloatMap, FloatMap]:
    plane = np.broadcast_to(np.float32(np.nan), size)
    return plane, plane


def _depth(disparity: FloatMap, pair: StereoPair, params: RefineParams) -> FloatMap | None:
    calibration = params.calibration(pair.shape)
    return None if calibration is None else _of_the_scene(calibration.depth_mm(disparity), pair)


def _of_the_scene(values: FloatMap, pair: StereoPair) -> FloatMap:
    """0 where the mask says that nothing of the scene is."""
    return values if pair.mask is None else values * pair.mask


def _at_input_size(trace: Trace, origins: Origins, params: RefineParams, backend: Backend) -> FloatMap:
    if trace.fused is None:
        enlarged = enlarge_disparity(trace.refined, trace.pair.shape, backend)
    else:
        enlarged = at_input_size(trace.fused, origins.initial, params.fusion.near_px, backend)
    if not enlarged.min() >= 0:
        enlarged = np.maximum(enlarged, 0)
    disparity = enlarged.astype(np.float32, copy=False)
    if "gdr" in params.stages:
        return disparity
    kept = origins.initial.valid & enlarge_mask(trace.kept, trace.pair.shape)
    return np.where(kept, origins.initial.u, disparity)


def _enlarged(confidence: Plane, size: Size, backend: Backend) -> FloatMap:
    return np.clip(backend.enlarge(confidence, size), 0, 1).astype(np.float32, copy=False)


def _meta(trace: Trace, params: RefineParams, backend: Backend) -> dict[str, Any]:
    calibration = params.calibration(trace.pair.shape)
    calibrated = {} if calibration is None else {"calibration": asdict(calibration)}
    device = {"device": trace.solved.device} if trace.solved is not None and trace.solved.device else {}
    return (
        calibrated
        | device
        | {
            "version": _version(),
            "kernel": backend.kernel,
            "preset": params.preset,
            "backend": backend.name if trace.solved is None else trace.solved.by,
            "initial": trace.start.kind,
            "params": params.model_dump(mode="json"),
        }
    )


@cache
def _version() -> str:
    # Looked up in files.
    return version("stereomend")


def _quality(trace: Trace, refined: Sparse, params: RefineParams, backend: Backend) -> dict[str, Any]:
    levels = len(level_sizes(trace.scene.size, params.gdr)) if "gdr" in params.stages else 0
    readings = [Reading(trace.scene.right, *sampled(sparse)) for sparse in (trace.start.working, refined)]
    before, after = residuals(trace.scene.left, readings, backend)
    return {"levels": levels, "residual_before": before, "residual_after": after}


def _warnings(trace: Trace, refined: Sparse, params: RefineParams, backend: Backend) -> Iterator[str]:
    if "ldr" in params.stages and trace.start.kind != "zero":
        if not (trace.confidence >= params.ldr.min_confidence).any():
            yield "no-inliers"
        if params.ldr.specular == "saturation" and not trace.scene.coloured:
            yield "no-colour"
    yield from warnings_of(trace.scene, trace.start.working, refined, backend)
    if trace.solved is not None:
        yield from trace.solved.warnings
