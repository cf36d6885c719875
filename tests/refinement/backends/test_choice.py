"""The share of the upload: the rules of R10 pixel by pixel, by plain loops, and one by one."""

import itertools
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereomend.refinement import parse_params, select_backend
from stereomend.refinement.backends import ChoiceRule, Grounds, Rivals

NATIVE, REFERENCE = select_backend("native", threads=2), select_backend("reference")
EVERY_BACKEND = pytest.mark.parametrize("backend", [NATIVE, REFERENCE], ids=lambda backend: backend.name)
FUSION = parse_params({"preset": "robust"}).fusion
RULE = ChoiceRule.of(FUSION, 0.75, 0)
EXACT = RULE._replace(
    near=1.125,
    step=0.75,
    spike=0.375,
    soft_edge=0.4375,
    enough=0.5,
    full_trust=0.625,
    high_trust=0.75,
    win_margin=0.0203,
    trusted_margin=0.1807,
)
"""Lengths and levels that are met exactly, and margins between the means of 25 64ths."""


class Loops(NamedTuple):
    """The share of the upload, pixel by pixel."""

    rivals: Rivals
    grounds: Grounds
    rule: ChoiceRule

    def steps_around(self, y, x):
        """The pixel between two neighbours of its row and of its column, where it has both."""
        u = self.rivals.upload.astype(float)
        height, width = u.shape
        across = [u[y, x - 1 : x + 2]] if 0 < x < width - 1 else []
        return [*across, u[y - 1 : y + 2, x]] if 0 < y < height - 1 else across

    def is_spike(self, y, x):
        rises = ((here - a, here - b) for a, here, b in self.steps_around(y, x))
        return any(
            (min(rise) > self.rule.spike or max(rise) < -self.rule.spike)
            and max(map(abs, rise)) <= 20 * min(map(abs, rise))
            for rise in rises
        )

    def is_straight(self, y, x):
        bends = [abs((b - here) - (here - a)) for a, here, b in self.steps_around(y, x)]
        return x >= self.rivals.upload[y, x] and max(bends, default=0) <= self.rule.step

    def is_smeared(self, y, x):
        """Whether u leads over a jump of the upload: farther inside of what that spans than it itself."""
        around = np.s_[max(y - 4, 0) : y + 5, max(x - 4, 0) : x + 5]
        spanned = self.rivals.upload[around][self.rivals.valid[around]].astype(float)
        if not spanned.size:
            return False
        inward, own = (
            min(float(u[y, x]) - spanned.min(), spanned.max() - float(u[y, x]))
            for u in (self.rivals.u, self.rivals.upload)
        )
        return inward > max(self.rule.near, own)

    def is_rough(self, y, x, uneven):
        window = uneven[max(y - 7, 0) : y + 8, max(x - 7, 0) : x + 8]
        return int(window.sum()) > Fraction(str(self.rule.rough_share)) * window.size

    def judged(self, y, x):
        """The share, None where the evidence is silent; and whether the pair lets a walk pass."""
        rivals, grounds, rule = self.rivals, self.grounds, self.rule
        if self.is_near(y, x):
            return (grounds.equal[y, x] if rivals.u_shown[y, x] else None), True
        lead, n = (
            np.pad(plane.astype(float), 2, mode="symmetric")[y : y + 5, x : x + 5].mean()
            for plane in (rivals.for_upload - rivals.for_u, rivals.for_u)
        )
        level = float(grounds.level[y, x])
        high = level >= rule.high_trust
        if not rivals.u_shown[y, x] or grounds.glints[y, x] or n < rule.weak_share * grounds.usual[y, x]:
            return None, True
        if high and (grounds.beside[y, x] or self.is_smeared(y, x)):
            return None, True
        margin = np.interp(level, [rule.full_trust, rule.high_trust], [rule.win_margin, -rule.trusted_margin])
        if not rivals.upload_shown[y, x]:
            return None, high and lead > margin
        return float(level > rule.enough and lead > margin), lead > margin

    def is_near(self, y, x):
        rivals = self.rivals
        return rivals.valid[y, x] and abs(rivals.upload[y, x] - rivals.u[y, x]) < self.rule.near

    def leads_on(self, soft, source, target):
        """Whether both lie on one surface."""
        u = self.rivals.upload
        return soft[source] or soft[target] or abs(float(u[source]) - float(u[target])) <= self.rule.step

    def walked(self, seeds, passing, soft):
        """Along rows right and left, columns down and up; round all corners where both maps are hidden."""
        reached, everywhere = seeds.copy(), list(np.ndindex(seeds.shape))
        for turn, (dy, dx) in enumerate(((0, 1), (0, -1), (1, 0), (-1, 0)) * 9):
            passing = passing if turn < 4 else passing & self.hidden
            for y, x in everywhere if dy + dx > 0 else reversed(everywhere):
                source = y - dy, x - dx
                if source in everywhere and reached[source] and passing[y, x]:
                    reached[y, x] |= self.leads_on(soft, source, (y, x))
        return reached

    @property
    def hidden(self):
        return ~(self.rivals.u_shown | self.rivals.upload_shown)

    def bridges(self, reached, passing):
        """Every line of passing pixels between two that are reached, if it never turns."""
        found = np.zeros_like(reached)
        for plane, flags, ways, u in (
            (found, reached, passing, self.rivals.upload),
            (found.T, reached.T, passing.T, self.rivals.upload.T),
        ):
            for y, row in enumerate(flags):
                ends = np.flatnonzero(row)
                for a, b in itertools.pairwise(ends):
                    steps = np.diff(u[y, a : b + 1])
                    if ways[y, a + 1 : b].all() and ((steps >= 0).all() or (steps <= 0).all()):
                        plane[y, a + 1 : b] = True
        return found

    def patch_sizes(self, straight, where):
        """By filling; doubled for each side of the picture that a patch touches."""
        sizes, last = np.zeros(straight.shape, int), np.subtract(straight.shape, 1)
        left = {(int(y), int(x)) for y, x in np.argwhere(where)}
        while left:
            patch = [left.pop()]
            for y, x in patch:
                around = {(y + 1, x), (y - 1, x), (y, x + 1), (y, x - 1)} & left
                found = [there for there in around if self.leads_on(straight, (y, x), there)]
                left.difference_update(found)
                patch += found
            places = np.array(patch)
            sides = np.count_nonzero((places == 0).any(0)) + np.count_nonzero((places == last).any(0))
            sizes[tuple(places.T)] = len(patch) * 2**sides
        return sizes

    def share(self):
        rivals, grounds, rule = self.rivals, self.grounds, self.rule
        uneven, straight, passing, seeds, kept = (np.zeros(rivals.u.shape, bool) for _ in range(5))
        for at in np.ndindex(uneven.shape):
            uneven[at], straight[at] = self.is_spike(*at) or not rivals.valid[at], self.is_straight(*at)
        for at in np.ndindex(uneven.shape):
            enough = grounds.level[at] > rule.enough
            seeds[at] = enough and self.is_near(*at) and rivals.u_shown[at] and rivals.upload_shown[at]
            smooth = not self.is_rough(*at, uneven)
            kept[at] = rivals.valid[at] and self.judged(*at)[1]
            passing[at] = kept[at] and enough and smooth
        kept &= self.patch_sizes(straight, kept) > rule.largest_patch
        reached = kept & self.walked(seeds, passing, straight | (grounds.edge < rule.soft_edge))
        bridged = self.bridges(reached, passing & self.hidden)
        share = (reached | bridged).astype(np.float32)
        for at in np.ndindex(uneven.shape):
            decided = self.judged(*at)[0]
            share[at] = share[at] if decided is None else decided
        return share * (kept | bridged)


@st.composite
def scenes(draw):
    """Quantised: eighths of a pixel, 64ths of evidence, levels that meet the limits; all in patches."""
    size = draw(st.sampled_from([(1, 1), (1, 14), (14, 1), (2, 2), (3, 9), (8, 9), (11, 17)]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))

    def some(values, side=4):
        coarse = rng.choice(values, (1 + size[0] // side, 1 + size[1] // side))
        return np.kron(coarse, np.ones((side, side), coarse.dtype))[: size[0], : size[1]]

    def share(*shares, side=1):
        return some(np.arange(1000), side) < 1000 * draw(st.sampled_from(shares))

    y, x = np.mgrid[: size[0], : size[1]]
    upload = draw(st.sampled_from([1, 3, 40])) + some([0, 0, 0.875, 4], draw(st.integers(3, 9)))
    upload += some(draw(st.sampled_from([[0], [0, 0.75, 0.875, 2]])), 6) * np.minimum(x, 9)
    upload += some(draw(st.sampled_from([[0], [0, 0.5, -1]])), 6) * y + 0.5 * share(0, 0.01, 0.05)
    valid = share(1, 0.97, 0.8)
    n = rng.integers(16, 48, size) / 64 + some([0, -0.25])
    other = n + rng.integers(-6, 5, size) / 64 + some([0, -0.125, 0.125])
    apart, levels = some([0, 0, 1, 1.125, -3]), [0.5, 0.5625, 0.625, 0.6875, 0.75, 1]
    ground = (
        some(draw(st.sampled_from([levels, [1]]))),
        rng.choice([0, 0.25, 1], size),
        some(np.arange(4, 13) / 16) + 0.003,
        some([0.375, 0.4375, 1, 1], 2),
    )
    upload = np.where(valid, upload, 0)
    planes = (plane.astype(np.float32) for plane in (upload, np.abs(upload + apart), other, n, *ground))
    upload, u, other, n, *ground = planes
    shown, u_shown = valid & share(1, 0.7, side=3), share(0.3, 0.7, 1, side=3)
    rivals = Rivals(upload, valid, u, other, n, shown, u_shown)
    return rivals, Grounds(*ground, share(0, 0.1), share(0, 0.4, side=3))


@EVERY_BACKEND
@settings(max_examples=120, deadline=None)
@given(
    scene=scenes(),
    rough_share=st.sampled_from([0.04, 0.12, 1.0]),
    largest=st.sampled_from([0, 1, 5, 40]),
)
def test_the_share_is_what_plain_loops_find(backend, scene, rough_share, largest):
    rule = EXACT._replace(rough_share=rough_share, largest_patch=largest)
    found = backend.choose(*scene, rule)
    assert found.shape == scene[0].u.shape
    assert (found == Loops(*scene, rule).share()).all()
