"""One refinement from input to result: preparation, initial, LDR, GDR."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereomend.disparity import (
    DisparityMap,
    Image,
    RefinementResult,
    StereoPair,
    as_mask,
    check_same_size,
)
from stereomend.refinement.backends import Backend, Plane, Size, Solved, select_backend
from stereomend.refinement.backends.coarse_to_fine import warps_of
from stereomend.refinement.fusion import Fused, Readings, fuse, grain_of
from stereomend.refinement.gdr import prior_of, refine_globally, with_edges
from stereomend.refinement.initial import choose_initial, match_semiglobally, uploaded
from stereomend.refinement.ldr import Local, confidence_of, fill_unknown, refine_locally
from stereomend.refinement.params import Initial, RefineParams, parse_params
from stereomend.refinement.pyramid import (
    Sparse,
    enlarge_disparity,
    enlarge_mask,
    working_size,
)
from stereomend.refinement.report import Mended, Start, Trace, describe, finish
from stereomend.refinement.scene import Scene, make_scene
from stereomend.refinement.watch import Steps, Watch, unwatched

STAGES = ("initial", "ldr", "gdr")


def refine(  # noqa: PLR0913 - the same names as `Client.refine`, and what computes
    left: Image,
    right: Image,
    disparity: npt.NDArray[Any] | None = None,
    *,
    mask: npt.NDArray[Any] | None = None,
    backend: str = "auto",
    threads: int = 0,
    **params: Any,
) -> RefinementResult:
    """Refine in this process what `Client.refine` would refine on a server.

    Args:
        left: uint8 or uint16, (H, W) or (H, W, 3) RGB, rectified.
        right: as `left`.
        disparity: (H, W) px, of the left image; not finite or <= 0 is unknown. None: matched by SGBM.
        mask: bool or integers, (H, W); 0 is not part of the scene. None: all is.
        backend: `auto`, `cuda`, `native` or `reference`.
        threads: threads to compute with; 0 means one per core.
        **params: fields of `RefineParams`, such as `preset="released"` or `gdr={"warps": 10}`.

    Raises:
        UnknownFormat: an array is of the wrong type.
        ShapeMismatch: heights or widths differ.
        InvalidParameter: a parameter is unknown or out of range, or the mask 0 everywhere.
        NoValidDisparity: the map has no usable pixel.
        BackendUnavailable: the backend does not work on this machine.
    """
    upload = None if disparity is None else DisparityMap.from_array(disparity)
    pair = StereoPair(left, right, None if mask is None else as_mask(np.asarray(mask)))
    return run(pair, upload, parse_params(params), select_backend(backend, threads))


def run(
    pair: StereoPair,
    upload: DisparityMap | None,
    params: RefineParams,
    backend: Backend,
    confidences: bool = True,
) -> RefinementResult:
    """Refine a disparity map; `upload` None starts from the matcher, or zero if the parameters say so.

    Without `confidences`, which few answers hold, both are NaN everywhere. The result's `timings` hold
    `prepare`, those of `STAGES` and `finish` in ms. Raises as `refine`.
    """
    mended = mend(prepare(pair, params, backend), upload, params, backend)
    return describe(mended, params, backend, confidences)


class Prepared(NamedTuple):
    """A pair at both sizes, and what that took [ms]."""

    pair: StereoPair
    scene: Scene
    took_ms: float


def prepare(pair: StereoPair, params: RefineParams, backend: Backend) -> Prepared:
    """What needs no disparity, so that its file may be decoded meanwhile (raises InvalidParameter)."""
    began = time.perf_counter()
    scene = make_scene(pair, working_size(pair.shape, params.processing_scale), params.ldr, backend)
    return Prepared(pair, scene, (time.perf_counter() - began) * 1e3)


def mend(
    prepared: Prepared,
    upload: DisparityMap | None,
    params: RefineParams,
    backend: Backend,
    watch: Watch = unwatched,
) -> Mended:
    """The map alone, which can be written while it is described; raises as `run`, and what `watch` raises."""
    pair, scene, took_ms = prepared
    if upload is not None:
        check_same_size("disparity", upload.shape, "left", pair.shape)
    kind = choose_initial(params, upload)
    timings = {"prepare": took_ms} | dict.fromkeys(STAGES, 0.0)
    with _stage("initial", kind == "sgbm", timings, watch):
        begun = Begun(scene, start_from(kind, upload, scene, pair, backend))
    with _stage("ldr", "ldr" in params.stages and kind != "zero", timings, watch):
        trusted = locally(begun, params, backend)
    solved, fused = None, None
    with _stage("gdr", "gdr" in params.stages, timings, watch):
        if "gdr" in params.stages:
            solved, fused = globally(begun, trusted, params, backend, watch)
            timings |= solved.copies
    trace = Trace(pair, *begun, *trusted, solved, fused)
    return finish(trace, params, backend, timings)


class Begun(NamedTuple):
    """The scene, and what starts the method."""

    scene: Scene
    start: Start


class Trusted(NamedTuple):
    """What LDR leaves."""

    confidence: Plane
    """Of the initial disparity, (H, W)."""
    local: Local


def locally(begun: Begun, params: RefineParams, backend: Backend) -> Trusted:
    """Measure the confidence and replace what has little; without stage `ldr` only fill the unknown."""
    (scene, start), steps = begun, max(1, round(params.ldr.search_px * params.processing_scale))
    confidence = confidence_of(start.working, scene, params.ldr, backend)
    if "ldr" in params.stages:
        return Trusted(confidence, refine_locally(start.working, confidence, params.ldr, steps, backend))
    return Trusted(confidence, fill_unknown(start.working, params.ldr, steps, backend))


def globally(
    begun: Begun, trusted: Trusted, params: RefineParams, backend: Backend, watch: Watch = unwatched
) -> tuple[Solved, Fused | None]:
    """GDR's map, and the choice between it and the upload where the parameters ask for one."""
    prior, scene = (
        prior_of(trusted.local, trusted.confidence, params.gdr),
        with_edges(begun.scene, params.gdr, backend),
    )
    steps = Steps(watch, "gdr", warps_of(scene.size, params.gdr))
    solved = refine_globally(scene, prior, params.gdr, backend, steps)
    if not params.fusion.enabled or begun.start.kind == "zero":
        return solved, None
    full = begun.start.full
    maps = Readings(backend.sample_sparse(full, scene.size), solved.u, grain_of(full))
    return solved, fuse(scene, maps, params, backend)


def start_from(
    kind: Initial, upload: DisparityMap | None, scene: Scene, pair: StereoPair, backend: Backend
) -> Start:
    """The initial disparity at both sizes (raises NoValidDisparity where there is none)."""
    size = pair.shape
    if kind == "sgbm":
        working = match_semiglobally(scene, backend)
        full = enlarge_disparity(working.u, size, backend)
        known = enlarge_mask(working.valid, size)
        if pair.mask is not None:
            known = known & pair.mask
        return Start(kind, Sparse(np.where(known, full, 0), known), working)
    if kind == "zero" or upload is None:
        return Start(kind, _nothing(size, backend), _nothing(scene.size, backend))
    full_size = uploaded(upload, pair.mask)
    return Start(kind, full_size, backend.shrink_sparse(full_size, scene.size))


def _nothing(size: Size, backend: Backend) -> Sparse:
    return Sparse(backend.plane(np.zeros(size)), np.zeros(size, np.bool_))


@contextmanager
def _stage(name: str, runs: bool, timings: dict[str, float], watch: Watch) -> Iterator[None]:
    if runs:
        watch(name, 0, 0)
    began = time.perf_counter()
    yield
    if runs:
        timings[name] = (time.perf_counter() - began) * 1e3
