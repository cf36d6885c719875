"""What the reference looks for along rows, columns and directions, in NumPy float64."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereomend.disparity import Mask

Array = npt.NDArray[np.float64]

NEIGHBOURS = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if (dy, dx) != (0, 0)]
"""The eight directions."""


def unknown_runs(known: Mask) -> list[tuple[int, int, int]]:
    """Row, first column and the one after the last of each run of unknown pixels between known ones."""
    runs = []
    for y, row in enumerate(known):
        edges = np.flatnonzero(np.diff(np.concatenate([[True], row, [True]]).astype(np.int8)))
        runs += [
            (y, int(a), int(b))
            for a, b in zip(edges[::2], edges[1::2], strict=True)
            if a > 0 and b < row.size
        ]
    return runs


_Turn = Callable[[npt.NDArray[Any]], npt.NDArray[Any]]


class Land(NamedTuple):
    """What can be walked on, each (H, W), as `Backend.reach` says."""

    reached: Mask
    passing: Mask
    soft: Mask
    u: Array


def walk_all_ways(land: Land, step: float) -> Mask:
    """What can be reached along rows right and left, then columns down and up."""
    for turn in (_as_it_is, _mirrored, _turned, _turned_over):
        land = land._replace(reached=turn(walk(Land(*map(turn, land)), step)))
    return np.ascontiguousarray(land.reached)


def walk_until_done(land: Land, step: float) -> Mask:
    """What can be reached along rows and columns, round any number of corners."""
    while not ((found := walk_all_ways(land, step)) == land.reached).all():
        land = land._replace(reached=found)
    return found


def bridges(reached: Mask, passing: Mask, u: Array) -> Mask:
    """Runs of passing pixels in a row or a column from one reached to another, only up or only down."""
    land, found = Land(reached, passing | reached, reached, u), np.zeros_like(reached)
    for there, back in ((_as_it_is, _mirrored), (_turned, _turned_over)):
        (up, down), (up_back, down_back) = (_slopes(land, turn) for turn in (there, back))
        found |= (up & down_back) | (down & up_back)
    return found & ~reached


def _slopes(land: Land, turn: _Turn) -> tuple[Mask, Mask]:
    """What can be reached along rows of the turned land only up, and only down."""
    turned = Land(*map(turn, land))
    up, down = (turn(_climb(turned._replace(u=sign * turned.u))) for sign in (1, -1))
    return up, down


def _climb(land: Land) -> Mask:
    reached = land.reached.copy()
    for x in range(1, reached.shape[1]):
        reached[:, x] |= reached[:, x - 1] & land.passing[:, x] & (land.u[:, x] >= land.u[:, x - 1])
    return reached


def _as_it_is(plane: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return plane


def _mirrored(plane: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return plane[:, ::-1]


def _turned(plane: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return plane.T


def _turned_over(plane: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return plane[::-1, ::-1].T


def walk(land: Land, step: float) -> Mask:
    """What can be reached from the left along rows."""
    reached = land.reached.copy()
    for x in range(1, reached.shape[1]):
        joined = np.abs(land.u[:, x] - land.u[:, x - 1]) <= step
        joined |= land.soft[:, x] | land.soft[:, x - 1]
        reached[:, x] |= reached[:, x - 1] & land.passing[:, x] & joined
    return reached


def directional_medians(u: Array, known: Mask, steps: int) -> Array:
    """Median of the first known values within `steps` steps in eight directions, NaN for none, (H, W)."""
    met = np.stack([_first_met(u, known, direction, steps) for direction in NEIGHBOURS])
    order = np.sort(met, axis=0)
    count = np.sum(np.isfinite(met), axis=0)
    lower, upper = (
        np.take_along_axis(order, np.maximum(i, 0)[None], 0)[0] for i in ((count - 1) // 2, count // 2)
    )
    return np.where(count > 0, (lower + upper) / 2, np.nan)


def _first_met(u: Array, known: Mask, direction: tuple[int, int], steps: int) -> Array:
    height, width = u.shape
    y, x = np.mgrid[:height, :width]
    met = np.full(u.shape, np.nan)
    for step in range(1, min(steps, max(height, width)) + 1):
        row, column = y + step * direction[0], x + step * direction[1]
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width) & np.isnan(met)
        hit = np.flatnonzero(inside)[known[row[inside], column[inside]]]
        met.flat[hit] = u[row.flat[hit], column.flat[hit]]
    return met


def from_nearest(u: Array, known: Mask) -> Array:
    """Replace what is not known by the nearest known value; of equals the leftmost, then the upper."""
    columns, rows = np.nonzero(known.T)
    result = u.copy()
    for y, x in np.argwhere(~known):
        nearest = np.argmin((rows - y) ** 2 + (columns - x) ** 2)
        result[y, x] = u[rows[nearest], columns[nearest]]
    return result
