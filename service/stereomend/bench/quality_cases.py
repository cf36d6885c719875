"""What quality is measured on: phantoms with exact truth, and maps of them, broken or already good."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count, cycle, islice, zip_longest
from typing import NamedTuple

from stereomend.disparity import DisparityMap
from stereomend.phantom import DAMAGES, Phantom, break_disparity, good_disparity, make_phantom

SEEDS_PER_BASE = 1000
"""Phantoms of base seed n have the seeds from n times this on: no two bases share one."""
QUICK_SHRINKS = 4
_SMALLEST_SIDE = 32
_GOOD = "good-"


@dataclass(frozen=True)
class View:
    """What the cameras of a phantom look at; lengths in px of the input."""

    width: int
    height: int
    max_disparity: float
    instrument: bool = False

    def shrunk(self, factor: int) -> View:
        """The same view with sides, of at least 32 px, and disparities divided by `factor`."""
        width, height = (max(side // factor, _SMALLEST_SIDE) for side in (self.width, self.height))
        return View(width, height, self.max_disparity / factor, self.instrument)


@dataclass(frozen=True)
class QualityCase:
    """A phantom and a map of it that is to be refined."""

    group: str
    damage: str
    """Kinds of `break_disparity` joined by "+", or the kind of `good_disparity`."""
    seed: int
    """Of the phantom and of the damage."""
    view: View

    def phantom(self) -> Phantom:
        """Make the phantom: some seconds at full laparoscopic size."""
        view = self.view
        return make_phantom(
            self.seed,
            view.width,
            view.height,
            max_disparity=view.max_disparity,
            instrument=view.instrument,
        )

    def upload(self, phantom: Phantom) -> DisparityMap:
        """The map to refine, of this case's phantom."""
        if self.group.startswith(_GOOD):
            return good_disparity(phantom, self.seed, self.damage)
        return break_disparity(phantom, self.seed, self.damage.split("+"))


class _Recipe(NamedTuple):
    """One phantom and its maps: pairs of group and damage."""

    view: View
    maps: tuple[tuple[str, str], ...]


_MIDDLE = View(640, 512, 40)
_SMALL = View(200, 160, 12)
_TINY = View(97, 75, 6)
# Full laparoscopic size; the nearest points lie beyond 60 px at working size.
_LARGE = View(1100, 1024, 140)
_WIDE = View(1280, 720, 125)
_HELD = replace(_MIDDLE, instrument=True)
_LARGE_HELD = replace(_LARGE, instrument=True)


def _all_good(view: View) -> _Recipe:
    """Maps of every kind that are right already; they share a phantom, which takes longest to make."""
    return _Recipe(view, tuple((_GOOD + kind, kind) for kind in ("smooth", "blurred", "quantised", "exact")))


def _broken(group: str, *maps: tuple[View, str]) -> list[_Recipe]:
    return [_Recipe(view, ((group, damage),)) for view, damage in maps]


_GROUPS = (
    _broken(
        "broken",
        (_MIDDLE, "mixed"),
        *((_MIDDLE, kind) for kind in DAMAGES),
        (_MIDDLE, "mixed+scale"),
        (_MIDDLE, "regions+streaks"),
        (_MIDDLE, "spikes+holes+border"),
        (_MIDDLE, "mixed"),
        (_SMALL, "mixed"),
        (_SMALL, "regions+spikes+border"),
        (_TINY, "mixed"),
    ),
    _broken(
        "large",
        (_LARGE, "mixed"),
        (replace(_LARGE, max_disparity=100), "regions+spikes+holes+border"),
        (_WIDE, "mixed"),
        (_LARGE, "mixed+scale"),
        (replace(_LARGE, max_disparity=80), "mixed"),
        (_LARGE, "spikes+streaks+border"),
    ),
    _broken(
        "instrument",
        (_HELD, "mixed"),
        (_HELD, "regions+streaks"),
        (_LARGE_HELD, "mixed"),
        (_HELD, "mixed"),
        (replace(_SMALL, instrument=True), "mixed"),
        (_HELD, "spikes+holes+border"),
    ),
    [_all_good(view) for view in (_MIDDLE, _HELD, _LARGE, _SMALL, _MIDDLE, _LARGE_HELD)],
)
# Turn by turn, so that few cases are of all groups.
_RECIPES = tuple(recipe for turn in zip_longest(*_GROUPS) for recipe in turn if recipe is not None)

ALL_CASES = sum(len(recipe.maps) for recipe in _RECIPES)
"""How many cases there are with one base seed until views and damages repeat, with other phantoms."""
ONE_OF_EACH = sum(len(group[0].maps) for group in _GROUPS)
"""How many cases from the first one on hold every group once."""


def plan_cases(seed: int, number: int, quick: bool = False) -> list[QualityCase]:
    """The first `number` cases of base `seed`, in turns over all groups; `quick`: a quarter of all lengths.

    Cases of the same phantom follow each other.
    """
    return list(islice(_endless(seed, QUICK_SHRINKS if quick else 1), number))


def _endless(seed: int, shrink: int) -> Iterator[QualityCase]:
    for own_seed, recipe in zip(count(SEEDS_PER_BASE * seed), cycle(_RECIPES), strict=False):
        for group, damage in recipe.maps:
            yield QualityCase(group, damage, own_seed, recipe.view.shrunk(shrink))
