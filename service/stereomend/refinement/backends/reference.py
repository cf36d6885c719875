"""The method in NumPy float64: readable and slow, the oracle of the tests.

Equation numbers are those of Yang, Simon, Linte, J. Med. Imaging 10(4), 045001, 2023; the solver is
Algorithm 1 of Chambolle and Pock, J. Math. Imaging Vis. 40, 2011, with theta = 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Image, Mask
from stereomend.refinement.backends import reference_cells as cells
from stereomend.refinement.backends import reference_evidence as parts
from stereomend.refinement.backends import reference_fusion as fusion
from stereomend.refinement.backends import sizes
from stereomend.refinement.backends.coarse_to_fine import coarse_to_fine
from stereomend.refinement.backends.data import (
    SMALLEST,
    UNGUIDED,
    BendRule,
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
from stereomend.refinement.backends.reference_search import (
    NEIGHBOURS,
    Land,
    directional_medians,
    from_nearest,
    unknown_runs,
    walk_all_ways,
)
from stereomend.refinement.stage_params import GdrParams, LdrParams

Array = npt.NDArray[np.float64]

MIN_NORM = 1e-3
"""Descriptors of less contrast [grey levels] are 0: below, float32 and float64 part ways."""
MIN_GREY = 1.0
"""Floor of I_s in Eq. 2 [grey levels]."""
GREY_WEIGHTS = (0.299, 0.587, 0.114)
"""BT.601 luma of R, G, B."""
HARDLY = 1e-6
"""A weight so small that it counts only where there is no other."""


class ReferenceBackend:
    """Implements `Backend`."""

    name = "reference"
    kernel = "numpy"

    def __init__(self, reason: str) -> None:
        self.reason = reason

    @property
    def alone(self) -> ReferenceBackend:
        """See `Backend.alone`."""
        return self

    def plane(self, array: npt.NDArray[Any]) -> Array:
        """See `Backend.plane`."""
        return np.array(array, np.float64)

    def shrink(self, image: Plane | Mask, size: Size) -> Plane:
        """See `Backend.shrink`."""
        return sizes.resized(sizes.area_weights, self.plane(image), size)

    def shrink_sparse(self, sparse: Sparse, size: Size) -> Sparse:
        """See `Backend.shrink_sparse`."""
        return sizes.shrink_sparse(sparse, size, self.shrink)

    def sample_sparse(self, sparse: Sparse, size: Size) -> Sparse:
        """See `Backend.sample_sparse`."""
        return sizes.sample_sparse(sparse, size)

    def shades(self, image: Image, size: Size) -> tuple[list[Plane], Plane]:
        """See `Backend.shades`."""
        levels = self._levels(image)
        if levels.ndim == 2:
            return [grey := self.shrink(levels, size)], grey
        channels = [self.shrink(levels[..., i], size) for i in range(3)]
        return channels, np.stack(channels, axis=-1) @ GREY_WEIGHTS

    def grey(self, image: Image, size: Size) -> Plane:
        """See `Backend.grey`."""
        levels = self._levels(image)
        return self.shrink(levels if levels.ndim == 2 else levels @ GREY_WEIGHTS, size)

    def _levels(self, image: Image) -> Array:
        return self.plane(image) / (257 if image.dtype == np.uint16 else 1)

    def enlarge(self, image: Plane, size: Size) -> Plane:
        """See `Backend.enlarge`."""
        return sizes.resized(sizes.linear_weights, image, size)

    def confidence(self, left: Plane, right: Plane, u: Plane, usable: Usable, params: LdrParams) -> Plane:
        """See `Backend.confidence`."""
        left, right, u = self.plane(left), self.plane(right), self.plane(u)
        position = np.arange(u.shape[1]) - u
        inside = (position >= 0) & (position <= u.shape[1] - 1)
        smooth = parts.smoothness(u, usable.valid, params) ** params.smoothness_power
        difference = np.abs(left - warp(right, u)) / np.maximum(left, MIN_GREY)
        photometric = np.maximum(0, 1 - params.photometric_weight * difference)
        return np.where(usable.valid & usable.matte & inside, smooth * photometric, 0.0)

    def fill(self, u: Plane, known: Mask, steps: int, passes: int) -> Plane:
        """See `Backend.fill`."""
        u, known = self.plane(u), known.copy()
        if not known.any():
            return u
        for _ in range(passes):
            medians = directional_medians(u, known, steps)
            found = ~known & np.isfinite(medians)
            u[found] = medians[found]
            known |= found
        return from_nearest(u, known)

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
        left, right, u = self.plane(left), self.plane(right), self.plane(u)
        own = describe(left, params.descriptor)
        p = np.zeros((2, *u.shape))
        for _ in range(params.warps):
            if tick is not None:
                tick()
            gg, gr = linearise(own, describe(warp(right, u), params.descriptor))
            share = np.ones(u.shape) if weight is None else self.plane(weight)
            if params.observed_only:
                share = share * ~self.unobserved(u)
            a, r = (window_mean(share * term, params.averaging_px) for term in (gg, gr))
            u, p = iterate(u, p, (a, r - a * u), params, guide)
        return u

    def globally(self, problem: Problem, params: GdrParams, tick: Tick | None = None) -> Solved:
        """See `Backend.globally`."""
        return Solved(coarse_to_fine(problem, params, self, tick), self.name)

    def evidence(self, left: Plane, right: Plane, maps: Sequence[Plane]) -> list[Plane]:
        """See `Backend.evidence`."""
        left, right = self.plane(left), self.plane(right)
        own = describe(left, "signed")
        warped = (describe(warp(right, self.plane(u)), "signed") for u in maps)
        return [parts.mean_5x5(np.sum(own * other, axis=0)) for other in warped]

    def better(self, left: Plane, right: Plane, u: Plane, other: Plane, rule: ReuseRule) -> Plane:
        """See `Backend.better`."""
        u, other = self.plane(u), self.plane(other)
        found, claimed = self.evidence(left, right, (u, other))
        stronger = (claimed > found + rule.margin) & (claimed > rule.least) & ~self.unobserved(other)
        return np.where(stronger & (np.abs(other - u) > rule.apart), other, u)

    def halve(self, planes: Sequence[Plane]) -> list[Plane]:
        """See `Backend.halve`."""
        return [sizes.resized(sizes.area_weights, plane, parts.half_of(plane)) for plane in planes]

    def halve_weighed(self, u: Plane, weight: Plane) -> tuple[Plane, Plane]:
        """See `Backend.halve_weighed`."""
        share = self.plane(weight) + HARDLY
        total, shares, weights = self.halve([share * u, share, weight])
        return total / shares * (total.shape[1] / u.shape[1]), weights

    def evidence_confidence(
        self, left: Plane, right: Plane, u: Plane, usable: Usable, params: LdrParams
    ) -> Plane:
        """See `Backend.evidence_confidence`."""
        (n,), u = self.evidence(left, right, [u]), self.plane(u)
        counts = usable.valid & usable.matte & (u > SMALLEST) & ~self.unobserved(u)
        counts &= ~self.speckles(u, usable.valid, SpeckleRule.of(params.speckle_share, u))
        share = (n - params.least_evidence) / max(params.full_evidence - params.least_evidence, 1e-9)
        confidence: Array = np.clip(share, 0, 1) * np.exp(-np.abs(u - parts.median_5x5(u))) * counts
        return confidence

    def speckles(self, u: Plane, valid: Mask, rule: SpeckleRule) -> Mask:
        """See `Backend.speckles`."""
        label = parts.patches(self.plane(u), valid, rule.step)
        small: Mask = valid & (parts.patch_sizes(label) <= rule.largest)
        return small

    def edge_weights(self, channels: Sequence[Plane], params: GdrParams) -> Plane:
        """See `Backend.edge_weights`."""
        steepest = np.max([np.hypot(*gradient(self.plane(channel))) for channel in channels], axis=0)
        weight: Array = np.exp(-((steepest / (params.edge_level or np.inf)) ** params.edge_power))
        return np.maximum(weight, params.edge_floor)

    def glints(self, channels: Sequence[Plane], rule: GlintRule) -> tuple[Mask, Mask]:
        """See `Backend.glints`."""
        largest, smallest = np.max(channels, axis=0), np.min(channels, axis=0)
        colourless = largest - smallest < rule.saturation * largest
        return colourless & (largest > rule.bright), largest > rule.nearly

    def fill_occlusions(self, u: Plane, known: Mask, rule: OcclusionRule) -> tuple[Plane, Mask]:
        """See `Backend.fill_occlusions`."""
        u, filled = self.plane(u), np.zeros(u.shape, np.bool_)
        for y, begin, end in unknown_runs(known):
            rise = u[y, end] - u[y, begin - 1]
            if rise > rule.step and end - begin <= rule.stretch * rise + rule.slack:
                u[y, begin:end] = u[y, begin - 1]
                filled[y, begin:end] = True
        return u, filled

    def reach(self, seeds: Mask, passing: Mask, soft: Mask, u: Plane, step: float) -> Mask:
        """See `Backend.reach`."""
        return walk_all_ways(Land(seeds, passing, soft, self.plane(u)), step)

    def poll(self, rivals: Rivals, matte: Mask, spoilt: Mask, rule: PollRule) -> Polls:
        """See `Backend.poll`."""
        return fusion.poll(rivals, matte, spoilt, rule)

    def ground(self, polls: Polls, size: Size, rule: GroundRule) -> Ground:
        """See `Backend.ground`."""
        return cells.ground(polls, size, rule)

    def bend(self, u: Plane, polls: Polls, rule: BendRule) -> Plane:
        """See `Backend.bend`."""
        return cells.bend(self.plane(u), polls, rule)

    def choose(self, rivals: Rivals, grounds: Grounds, rule: ChoiceRule) -> Plane:
        """See `Backend.choose`."""
        return fusion.choose(rivals, grounds, rule)

    def merge(self, offer: Offer, upload: Plane, valid: Mask, near: float) -> Plane:
        """See `Backend.merge`."""
        size, given = (upload.shape[0], upload.shape[1]), Offer(*map(self.plane, offer))
        large = given._replace(u=self.enlarge(given.u, size), share=self.enlarge(given.share, size))
        return fusion.merge(given, large, upload, valid, near)

    def mismatch(self, left: Plane, readings: Sequence[Reading]) -> list[tuple[float, int]]:
        """See `Backend.mismatch`."""
        return [self._mismatch(self.plane(left), reading) for reading in readings]

    def _mismatch(self, left: Array, reading: Reading) -> tuple[float, int]:
        seen = reading.valid & ~self.unobserved(reading.u)
        if not seen.any():
            return 0.0, 0
        distances = distance(left, self.plane(reading.right), self.plane(reading.u))
        return float(distances[seen].mean()), int(np.count_nonzero(seen))

    def unobserved(self, u: Plane) -> Mask:
        """See `Backend.unobserved`."""
        return parts.unobserved(self.plane(u))

    def shown(self, sparse: Sparse) -> tuple[Mask, Mask]:
        """See `Backend.shown`."""
        return parts.shown(self.plane(sparse.u), sparse.valid)

    def tell(self, u: Plane, origins: Origins) -> tuple[npt.NDArray[np.uint8], list[int]]:
        """See `Backend.tell`."""
        return sizes.tell(u, self.unobserved(u), origins)


def warp(right: Array, u: Array) -> Array:
    """The right image at x - u, linear in between, borders repeated, (H, W)."""
    width = right.shape[1]
    position = np.clip(np.arange(width) - u, 0, width - 1)
    before = np.minimum(np.floor(position).astype(np.intp), max(width - 2, 0))
    after = np.minimum(before + 1, width - 1)
    rows = np.arange(right.shape[0])[:, None]
    fraction = position - before
    warped: Array = (1 - fraction) * right[rows, before] + fraction * right[rows, after]
    return warped


def describe(image: Array, descriptor: str) -> Array:
    """Differences to the 3 x 3 neighbours divided by their norm (Eq. 10), (8, H, W); borders repeated."""
    height, width = image.shape
    padded = np.pad(image, 1, mode="edge")
    shifted = [padded[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width] for dy, dx in NEIGHBOURS]
    differences = np.stack(shifted) - image
    if descriptor == "absolute":
        differences = np.abs(differences)
    norm = np.sqrt(np.sum(differences**2, axis=0))
    described: Array = np.divide(differences, norm, out=np.zeros_like(differences), where=norm > MIN_NORM)
    return described


def distance(left: Array, right: Array, u: Array) -> Array:
    """Euclidean distance between left and warped right signed descriptors, 0 to 2, (H, W)."""
    difference = describe(warp(right, u), "signed") - describe(left, "signed")
    result: Array = np.sqrt(np.sum(difference**2, axis=0))
    return result


def linearise(own: Array, warped: Array) -> tuple[Array, Array]:
    """The sums over descriptors (8, H, W) of g^2 and g (D2 - D1), each (H, W): the data term around u."""
    slope = np.gradient(warped, axis=2) if own.shape[2] > 1 else np.zeros_like(warped)
    g = -slope
    return np.sum(g * g, axis=0), np.sum(g * (warped - own), axis=0)


def window_mean(values: Array, deviation: float) -> Array:
    """Mean under a Gaussian of `deviation` px, cut off at twice that; borders are mirrored; (H, W) (R5)."""
    radius = int(np.ceil(2 * deviation))
    for axis in (0, 1):
        side = values.shape[axis]
        place = np.arange(side)[:, None] + np.arange(-radius, radius + 1)
        mirrored = np.clip(
            np.where(place < 0, -1 - place, np.where(place >= side, 2 * side - 1 - place, place)), 0, side - 1
        )
        taps = np.exp(-0.5 * (np.arange(-radius, radius + 1) / max(deviation, 1e-9)) ** 2)
        taken = np.moveaxis(values, axis, 0)[mirrored]
        values = np.moveaxis(np.einsum("itk,t->ik", taken, taps / taps.sum()), 0, axis)
    return values


def gradient(u: Array) -> Array:
    """Forward differences along x and y, (2, H, W), 0 at the far border."""
    result = np.zeros((2, *u.shape))
    result[0, :, :-1] = np.diff(u, axis=1)
    result[1, :-1] = np.diff(u, axis=0)
    return result


def divergence(p: Array) -> Array:
    """Minus the adjoint of `gradient`: (2, H, W) to (H, W)."""
    result = np.zeros(p.shape[1:])
    result[:, :-1] += p[0, :, :-1]
    result[:, 1:] -= p[0, :, :-1]
    result[:-1] += p[1, :-1]
    result[1:] -= p[1, :-1]
    return result


def prox_dual(p: Array, sigma: float, epsilon: float, edge: Array | float = 1.0) -> Array:
    """The prox of sigma times the conjugate of the weighed Huber norm, p (2, H, W), weight (H, W)."""
    p = p / (1 + sigma * epsilon / edge)
    result: Array = p / np.maximum(1, np.sqrt(np.sum(p**2, axis=0)) / edge)
    return result


def prox_data(
    u: Array, step: float, data: tuple[Array, Array], draw: tuple[Array, Array] | None = None
) -> Array:
    """argmin over v of (v - u)^2 / 2 + step (A v^2 / 2 + B v) + weight |v - prior|, each (H, W).

    `draw` is the prior and its weight; None for none.
    """
    a, b = data
    free: Array = (u - step * b) / (1 + step * a)
    if draw is None:
        return free
    prior, weight = draw
    away = free - prior
    drawn: Array = prior + np.sign(away) * np.maximum(np.abs(away) - weight / (1 + step * a), 0)
    return drawn


def iterate(
    u: Array, p: Array, data: tuple[Array, Array], params: GdrParams, guide: Guide = UNGUIDED
) -> tuple[Array, Array]:
    """The primal-dual iterations of one warp; returns u (H, W) and p (2, H, W)."""
    u_bar, step = u, 2 * params.data_weight * params.tau
    edge = 1.0 if guide.edge is None else np.asarray(guide.edge, np.float64)
    draw = None
    if guide.prior is not None and guide.trust is not None:
        draw = np.asarray(guide.prior, np.float64), params.tau * np.asarray(guide.trust, np.float64)
    for _ in range(params.iterations):
        p = prox_dual(p + params.sigma * gradient(u_bar), params.sigma, params.huber_epsilon, edge)
        old = u
        u = prox_data(u + params.tau * divergence(p), step, data, draw)
        u_bar = 2 * u - old
    return u, p
