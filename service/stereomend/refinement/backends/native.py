"""The C++ kernels, float32, on all cores given."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from stereomend import _native
from stereomend.disparity import FloatMap, Image, Mask
from stereomend.opencv import cv2
from stereomend.refinement.backends.coarse_to_fine import coarse_to_fine
from stereomend.refinement.backends.data import (
    HALF,
    SMALLEST,
    UNGUIDED,
    BendRule,
    Cells,
    ChoiceRule,
    GlintRule,
    Ground,
    GroundRule,
    Grounds,
    Guide,
    OcclusionRule,
    Offer,
    Origins,
    Plane,
    PollRule,
    Polls,
    Problem,
    Reading,
    ReuseRule,
    Rivals,
    Size,
    Solved,
    Sparse,
    SpeckleRule,
    Tick,
    Usable,
)
from stereomend.refinement.stage_params import GdrParams, LdrParams


class NativeBackend:
    """Implements `Backend`; results are bitwise equal for any number of threads."""

    name = "native"
    kernel = _native.KERNEL_HASH

    def __init__(self, threads: int, reason: str, engine: _native.Engine | None = None) -> None:
        self._engine = engine or _native.Engine(threads)
        self.reason = reason

    @cached_property
    def alone(self) -> NativeBackend:
        """See `Backend.alone`."""
        return NativeBackend(1, self.reason)

    def plane(self, array: npt.NDArray[Any]) -> FloatMap:
        """See `Backend.plane`."""
        return np.ascontiguousarray(array, np.float32)

    def shrink(self, image: Plane | Mask, size: Size) -> Plane:
        """See `Backend.shrink`."""
        samples = np.ascontiguousarray(image) if image.dtype == np.bool_ else self.plane(image)
        return self._engine.shrink(samples, *size)[0]

    def shrink_sparse(self, sparse: Sparse, size: Size) -> Sparse:
        """See `Backend.shrink_sparse`."""
        return Sparse(
            *self._engine.shrink_sparse(self.plane(sparse.u), _flags(sparse.valid), *size, half=HALF)
        )

    def sample_sparse(self, sparse: Sparse, size: Size) -> Sparse:
        """See `Backend.sample_sparse`."""
        return Sparse(*self._engine.sample_sparse(self.plane(sparse.u), _flags(sparse.valid), *size))

    def shades(self, image: Image, size: Size) -> tuple[list[Plane], Plane]:
        """See `Backend.shades`."""
        planes = self._engine.shrink(np.ascontiguousarray(image), *size)
        return [*planes[:3]], planes[-1]

    def grey(self, image: Image, size: Size) -> Plane:
        """See `Backend.grey`."""
        return self._engine.shrink(np.ascontiguousarray(image), *size, grey=True)[0]

    def enlarge(self, image: Plane, size: Size) -> Plane:
        """See `Backend.enlarge`."""
        height, width = size
        enlarged = cv2.resize(image, (width, height), interpolation=cv2.INTER_LINEAR)
        return np.asarray(enlarged, np.float32)

    def confidence(self, left: Plane, right: Plane, u: Plane, usable: Usable, params: LdrParams) -> Plane:
        """See `Backend.confidence`."""
        planes = (self.plane(left), self.plane(right), self.plane(u))
        constants = _native.ConfidenceParams(
            window=params.window,
            smoothness_weight=params.smoothness_weight,
            smoothness_power=params.smoothness_power,
            photometric_weight=params.photometric_weight,
        )
        return self._engine.confidence(*planes, usable.valid, usable.matte, constants)

    def fill(self, u: Plane, known: Mask, steps: int, passes: int) -> Plane:
        """See `Backend.fill`."""
        return self._engine.fill(self.plane(u), known, steps, passes)

    def solve(  # noqa: PLR0913 - as `Backend.solve`
        self,
        left: Plane,
        right: Plane,
        u: Plane,
        params: GdrParams,
        *,
        weight: Plane | None = None,
        guide: Guide = UNGUIDED,
        tick: Tick | None = None,
    ) -> Plane:
        """See `Backend.solve`."""
        constants = _native.SolverParams(
            data_weight=params.data_weight,
            huber_epsilon=params.huber_epsilon,
            tau=params.tau,
            sigma=params.sigma,
            warps=params.warps,
            iterations=params.iterations,
            absolute=params.descriptor == "absolute",
            observed_only=params.observed_only,
            averaging=params.averaging_px,
        )
        planes = (self.plane(left), self.plane(right), self.plane(u))
        share, edge, prior, trust = (None if part is None else self.plane(part) for part in (weight, *guide))
        return self._engine.solve(*planes, share, constants, edge, prior, trust, tick)

    def globally(self, problem: Problem, params: GdrParams, tick: Tick | None = None) -> Solved:
        """See `Backend.globally`."""
        return Solved(coarse_to_fine(problem, params, self, tick), self.name)

    def evidence(self, left: Plane, right: Plane, maps: Sequence[Plane]) -> list[Plane]:
        """See `Backend.evidence`."""
        return [*self._engine.evidence(self.plane(left), self.plane(right), [self.plane(u) for u in maps])]

    def better(self, left: Plane, right: Plane, u: Plane, other: Plane, rule: ReuseRule) -> Plane:
        """See `Backend.better`."""
        planes = (self.plane(left), self.plane(right), self.plane(u), self.plane(other))
        return self._engine.better(*planes, *rule)

    def halve(self, planes: Sequence[Plane]) -> list[Plane]:
        """See `Backend.halve`."""
        return [*self._engine.halve([self.plane(plane) for plane in planes])]

    def halve_weighed(self, u: Plane, weight: Plane) -> tuple[Plane, Plane]:
        """See `Backend.halve_weighed`."""
        return self._engine.halve_weighed(self.plane(u), self.plane(weight))

    def evidence_confidence(
        self, left: Plane, right: Plane, u: Plane, usable: Usable, params: LdrParams
    ) -> Plane:
        """See `Backend.evidence_confidence`."""
        planes = (self.plane(left), self.plane(right), self.plane(u))
        constants = _native.TrustParams(
            least=params.least_evidence, full=params.full_evidence, smallest=SMALLEST
        )
        rule = _rule(SpeckleRule.of(params.speckle_share, u))
        return self._engine.trust(*planes, usable.valid, usable.matte, constants, rule)

    def speckles(self, u: Plane, valid: Mask, rule: SpeckleRule) -> Mask:
        """See `Backend.speckles`."""
        return self._engine.speckles(self.plane(u), valid, _rule(rule))

    def edge_weights(self, channels: Sequence[Plane], params: GdrParams) -> Plane:
        """See `Backend.edge_weights`."""
        planes = [self.plane(channel) for channel in channels]
        return self._engine.edge_weights(
            planes, params.edge_level or np.inf, params.edge_power, params.edge_floor
        )

    def glints(self, channels: Sequence[Plane], rule: GlintRule) -> tuple[Mask, Mask]:
        """See `Backend.glints`."""
        planes = [self.plane(channel) for channel in channels]
        return self._engine.glints(planes, rule.saturation, rule.bright, rule.nearly)

    def fill_occlusions(self, u: Plane, known: Mask, rule: OcclusionRule) -> tuple[Plane, Mask]:
        """See `Backend.fill_occlusions`."""
        return self._engine.fill_occlusions(self.plane(u), known, rule.step, rule.stretch, rule.slack)

    def reach(self, seeds: Mask, passing: Mask, soft: Mask, u: Plane, step: float) -> Mask:
        """See `Backend.reach`."""
        return self._engine.reach(seeds, passing, soft, self.plane(u), step)

    def poll(self, rivals: Rivals, matte: Mask, spoilt: Mask, rule: PollRule) -> Polls:
        """See `Backend.poll`."""
        least, full = rule.clear
        constants = _native.PollRule(
            tolerance=rule.tolerance,
            near=rule.near,
            lack=rule.lack,
            most=rule.most,
            least=least,
            full=full,
            frame=rule.frame,
        )
        planes = self._engine.poll(rivals, matte, spoilt, constants)
        return Polls(*planes.reshape(len(Polls._fields), -1, planes.shape[1]))

    def ground(self, polls: Polls, size: Size, rule: GroundRule) -> Ground:
        """See `Backend.ground`."""
        return Ground(*self._engine.ground(_stacked(polls), *size, _native.GroundRule(**rule._asdict())))

    def bend(self, u: Plane, polls: Polls, rule: BendRule) -> Plane:
        """See `Backend.bend`."""
        return self._engine.bend(self.plane(u), _stacked(polls), _native.BendRule(**rule._asdict()))

    def choose(self, rivals: Rivals, grounds: Grounds, rule: ChoiceRule) -> Plane:
        """See `Backend.choose`."""
        return self._engine.choose(rivals, grounds, _native.ChoiceRule(**rule._asdict()))

    def merge(self, offer: Offer, upload: Plane, valid: Mask, near: float) -> Plane:
        """See `Backend.merge`."""
        u, share, sample, upload = (self.plane(plane) for plane in (*offer, upload))
        return self._engine.merge(u, share, sample, upload, valid, near, HALF)

    def mismatch(self, left: Plane, readings: Sequence[Reading]) -> list[tuple[float, int]]:
        """See `Backend.mismatch`."""
        planes = [(self.plane(right), self.plane(u), valid) for right, u, valid in readings]
        return self._engine.mismatch(self.plane(left), planes)

    def unobserved(self, u: Plane) -> Mask:
        """See `Backend.unobserved`."""
        return self._engine.unobserved(self.plane(u))

    def shown(self, sparse: Sparse) -> tuple[Mask, Mask]:
        """See `Backend.shown`."""
        return self._engine.shown(self.plane(sparse.u), _flags(sparse.valid))

    def tell(self, u: Plane, origins: Origins) -> tuple[npt.NDArray[np.uint8], list[int]]:
        """See `Backend.tell`."""
        initial, kept, scene, within = origins
        scene = None if scene is None else _flags(scene)
        planes = (self.plane(u), self.plane(initial.u), _flags(initial.valid), _flags(kept))
        return self._engine.tell(*planes, scene, within)


def _stacked(polls: Polls) -> Cells:
    return np.concatenate(polls)


def _flags(mask: Mask) -> Mask:
    return np.ascontiguousarray(mask)


def _rule(rule: SpeckleRule) -> _native.SpeckleRule:
    return _native.SpeckleRule(largest=rule.largest, step=rule.step)
