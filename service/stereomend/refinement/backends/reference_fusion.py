"""The choice between the upload and GDR's map (R8 to R10) of the reference, in NumPy float64."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Mask
from stereomend.refinement.backends.data import (
    CELL,
    HALF,
    ChoiceRule,
    Grounds,
    Offer,
    Plane,
    PollRule,
    Polls,
    Rivals,
)
from stereomend.refinement.backends.reference_evidence import (
    mean_5x5,
    patch_sizes,
    patches,
    range_around,
    sample,
)
from stereomend.refinement.backends.reference_search import Land, bridges, walk_all_ways, walk_until_done

Array = npt.NDArray[np.float64]

_SEEN = 4  # px that what is compared of a pixel reaches to each side
_AROUND = 7  # px on each side of the window that roughness is looked for in
_ALIKE = 20  # times as far from one neighbour as from the other; at the foot of a jump more
_HARDLY = 1e-4  # of a pixel: rounding shall not decide whether a count is over a share


def ramp(values: Array, low: float, high: float) -> Array:
    """0 up to `low`, 1 from `high` on, linear between them."""
    return np.asarray(np.clip((values - low) / max(high - low, 1e-9), 0, 1), np.float64)


def poll(rivals: Rivals, matte: Mask, spoilt: Mask, rule: PollRule) -> Polls:
    """See `Backend.poll`."""
    upload, u, n = (np.asarray(plane, np.float64) for plane in (rivals.upload, rivals.u, rivals.for_u))
    inside = np.arange(u.shape[1]) - u > rule.frame
    votes = ramp(n, *rule.clear) * (rivals.u_shown & rivals.upload_shown & matte & inside)
    agreeing = votes * np.exp(-(((upload - u) / rule.tolerance) ** 2))
    leads = np.asarray(rivals.for_upload, np.float64) - n
    against = (votes - agreeing) * ramp(-leads, 0, rule.lack)
    fair = votes * (near(rivals, rule.near) & ~spoilt)
    shown = rivals.u_shown.astype(np.float64)
    trust = (agreeing + against, agreeing)
    lead = fair * np.clip(leads, -rule.most, rule.most)
    parts = (*trust, fair, lead, fair * n, shown, shown * u, shown * u * u)
    return Polls(*map(cells, parts))


def cells(values: Array) -> Array:
    """Means over cells, (H / CELL, W / CELL) rounded up."""
    sums, sizes = values, np.ones(values.shape)
    for axis in (0, 1):
        starts = np.arange(0, values.shape[axis], CELL)
        sums, sizes = (np.add.reduceat(part, starts, axis=axis) for part in (sums, sizes))
    mean: Array = sums / sizes
    return mean


def near(rivals: Rivals, limit: float) -> Mask:
    """Where both maps say nearly the same, (H, W)."""
    found: Mask = rivals.valid & (np.abs(rivals.upload - rivals.u) < limit)
    return found


class _Settled(NamedTuple):
    """What the evidence decides, each (H, W)."""

    decided: Mask
    share: Array
    """Where it is decided."""
    seeds: Mask
    passing: Mask
    uncontradicted: Mask


def choose(rivals: Rivals, grounds: Grounds, rule: ChoiceRule) -> Array:
    """See `Backend.choose`."""
    upload = np.asarray(rivals.upload, np.float64)
    settled, even = _settle(rivals, grounds, rule), straight(upload, rule.step)
    soft = even | (grounds.edge < rule.soft_edge)
    label = patches(upload, settled.uncontradicted, rule.step, even)
    kept = settled.uncontradicted & (patch_sizes(label) > rule.largest_patch)
    land = Land(settled.seeds, settled.passing, soft, upload)
    hidden = settled.passing & ~(rivals.u_shown | rivals.upload_shown)
    land = land._replace(reached=walk_all_ways(land, rule.step), passing=hidden)
    reached = walk_until_done(land, rule.step) & kept
    bridged = bridges(reached, hidden, upload)
    return np.where(settled.decided, settled.share, reached | bridged) * (kept | bridged)


def _settle(rivals: Rivals, grounds: Grounds, rule: ChoiceRule) -> _Settled:
    level, close = np.asarray(grounds.level, np.float64), near(rivals, rule.near)
    high, enough = level >= rule.high_trust, level > rule.enough
    n = np.asarray(rivals.for_u, np.float64)
    margin = rule.win_margin - (rule.win_margin + rule.trusted_margin) * ramp(
        level, rule.full_trust, rule.high_trust
    )
    better = mean_5x5(rivals.for_upload - n) > margin
    wins = rivals.upload_shown & better
    strong = rivals.u_shown & ~grounds.glints & (mean_5x5(n) >= rule.weak_share * grounds.usual)
    excused = (grounds.beside | smeared(rivals, rule.near)) & high
    comparable = rivals.upload_shown & ~excused
    contradicted = strong & ~close & ~(better & (rivals.upload_shown | high)) & ~excused
    uncontradicted = rivals.valid & ~contradicted
    uneven = spikes(np.asarray(rivals.upload, np.float64), rule.spike) | ~rivals.valid
    return _Settled(
        np.where(close, rivals.u_shown, strong & comparable),
        np.where(close, grounds.equal, enough & wins),
        enough & close & rivals.u_shown & rivals.upload_shown,
        uncontradicted & enough & few_around(uneven, rule.rough_share),
        uncontradicted,
    )


def smeared(rivals: Rivals, least: float) -> Mask:
    """Where GDR's map leads over a jump of the upload: over `least` px, and farther, from both its sides."""
    low, high = range_around(rivals.upload, rivals.valid, _SEEN)
    inward, own = (np.minimum(u - low, high - u) for u in (rivals.u, rivals.upload))
    found: Mask = (inward > least) & (inward > own)
    return found


def spikes(u: Array, height: float) -> Mask:
    """Above or below both neighbours of the row, or of the column, by more than `height`, and by alike."""
    found = np.zeros(u.shape, np.bool_)
    for axis in (0, 1):
        step, flags = np.moveaxis(np.diff(u, axis=axis), axis, 0), np.moveaxis(found, axis, 0)
        back, forth = step[:-1], -step[1:]
        least, most = (of(np.abs(back), np.abs(forth)) for of in (np.minimum, np.maximum))
        flags[1:-1] |= (np.sign(back) == np.sign(forth)) & (least > height) & (most <= _ALIKE * least)
    return found


def straight(u: Array, step: float) -> Mask:
    """Slopes that go on as they came, up to `step` px, along both axes, and do not leave the frame."""
    found: Mask = np.arange(u.shape[1]) >= u
    for axis in (0, 1):
        bend, flags = np.moveaxis(np.abs(np.diff(u, 2, axis=axis)), axis, 0), np.moveaxis(found, axis, 0)
        flags[1:-1] &= bend <= step
    return found


def few_around(flags: Mask, share: float) -> Mask:
    """Whether up to a share of the pixels within 7 px along both axes, inside the picture, is flagged."""
    sums, sizes = flags.astype(np.float64), np.ones(flags.shape)
    for axis in (0, 1):
        sums, sizes = (_sum_around(part, axis) for part in (sums, sizes))
    few: Mask = sums <= share * sizes + _HARDLY
    return few


def _sum_around(values: Array, axis: int) -> Array:
    padding = [(0, 0), (0, 0)]
    padding[axis] = (_AROUND, _AROUND)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, padding), 2 * _AROUND + 1, axis=axis)
    total: Array = windows.sum(axis=-1)
    return total


def merge(offer: Offer, enlarged: Offer, upload: Plane, valid: Mask, near: float) -> Plane:
    """See `Backend.merge`; `enlarged`: the map and the share at input size, values as they were."""
    size = (upload.shape[0], upload.shape[1])
    ratio = size[1] / offer.u.shape[1]
    u, share = enlarged.u * ratio, enlarged.share
    judged = np.where(sample(offer.share, size) > HALF, sample(offer.sample, size) * ratio, u)
    least, most = (sample(bound, size) * ratio for bound in range_around(offer.sample, offer.share > HALF, 1))
    chosen = np.where((upload >= least - 1) & (upload <= most + 1), upload, judged)
    hard = np.where(share > HALF, chosen, u)
    blended = share * upload + (1 - share) * u
    return np.maximum(np.where(valid, np.where(np.abs(upload - u) < near, blended, hard), u), 0)
