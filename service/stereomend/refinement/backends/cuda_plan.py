"""How one level's work is cut into launches: tiles, iterations per launch, windows. No CUDA in here.

The constants are those of `kernels/gdr_iterate.cuh` and its neighbours.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stereomend.refinement.backends.data import (
    Size,
)

LANES = 32
BLOCK_ROWS = 8
TILE = 64
STRIPS = 8
LINEARISED = LANES - 2
AVERAGED_ROWS = 32
MOST_RADIUS = 8

MOST_FUSED = 10
"""Iterations per launch: with more, tiles overlap so far that work grows faster than traffic shrinks."""

LONGEST_SIDE = 65535 * BLOCK_ROWS
"""A taller picture has more rows of blocks than a launch may have, px."""

Grid = tuple[int, int, int]


class Shape(NamedTuple):
    """Of a launch: blocks, and threads of each."""

    grid: Grid
    block: Grid


def laps(size: Size, iterations: int) -> list[int]:
    """How many iterations each launch does: all at once where one tile holds the whole picture."""
    if max(size) <= TILE:
        return [iterations]
    count = math.ceil(iterations / MOST_FUSED)
    return [iterations // count + (lap < iterations % count) for lap in range(count)]


def tiles(side: int, iterations: int) -> int:
    """Tiles along a side: they overlap by twice the iterations, as each iteration looks one pixel further."""
    return 1 + max(0, math.ceil((side - TILE) / max(1, TILE - 2 * iterations)))


def iterating(size: Size, iterations: int) -> Shape:
    """Of `iterate` and `iterate_guided`."""
    return Shape((tiles(size[1], iterations), tiles(size[0], iterations), 1), (TILE, STRIPS, 1))


def per_pixel(size: Size, layers: int = 1, columns: int = LANES, rows: int = BLOCK_ROWS) -> Shape:
    """Of a kernel whose blocks make `columns` x `rows` pixels each."""
    return Shape((-(-size[1] // columns), -(-size[0] // rows), layers), (LANES, BLOCK_ROWS, 1))


def per_row(size: Size) -> Shape:
    """Of a kernel that takes a warp per row."""
    return Shape((-(-size[0] // BLOCK_ROWS), 1, 1), (LANES, BLOCK_ROWS, 1))


def window(deviation: float) -> list[float]:
    """Half of a Gaussian, cut off at twice its standard deviation [px], from the centre on; sums to 1."""
    radius = min(MOST_RADIUS, math.ceil(2 * deviation))
    taps = [math.exp(-0.5 * (i / deviation) ** 2) if i else 1.0 for i in range(radius + 1)]
    total = taps[0] + 2 * sum(taps[1:])
    return [tap / total for tap in taps]
