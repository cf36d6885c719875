"""How work is cut into launches; needs no CUDA."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereomend.refinement.backends import cuda_plan as plan

sides, counts = st.integers(1, 5000), st.integers(1, 1000)


def written(side, iterations):
    """How often each pixel of a side is written, by the rule of `store_column`."""
    times = np.zeros(side, int)
    for tile in range(plan.tiles(side, iterations)):
        begin = tile * (plan.TILE - 2 * iterations)
        first = begin + (iterations if begin > 0 else 0)
        last = begin + plan.TILE - (iterations if begin + plan.TILE < side else 0)
        times[first:last] += 1
    return times


@given(side=sides, iterations=st.integers(1, plan.MOST_FUSED))
def test_tiles_write_every_pixel_once(side, iterations):
    assert (written(side, iterations) == 1).all()


@given(side=st.integers(1, plan.TILE), iterations=counts)
def test_one_tile_holds_a_small_side_whatever_the_iterations(side, iterations):
    assert plan.tiles(side, iterations) == 1
    assert (written(side, iterations) == 1).all()


@given(size=st.tuples(sides, sides), iterations=counts)
def test_no_iteration_is_lost(size, iterations):
    laps = plan.laps(size, iterations)
    assert sum(laps) == iterations
    assert max(laps) <= plan.MOST_FUSED or max(size) <= plan.TILE
    assert max(laps) - min(laps) <= 1


@given(size=st.tuples(sides, sides))
def test_blocks_cover_the_picture_and_no_more(size):
    (across, down, _), (columns, rows, _) = plan.per_pixel(size)
    assert (across - 1) * columns < size[1] <= across * columns
    assert (down - 1) * rows < size[0] <= down * rows


@pytest.mark.parametrize("deviation", [0.01, 0.5, 1.3, 3.5, 4.0])
def test_a_window_sums_to_one(deviation):
    taps = plan.window(deviation)
    assert taps[0] + 2 * sum(taps[1:]) == pytest.approx(1)
    assert len(taps) <= plan.MOST_RADIUS + 1
    assert taps == sorted(taps, reverse=True)
