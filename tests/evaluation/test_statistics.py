from itertools import product

import numpy as np
import pytest

from stereomend.evaluation.statistics import compare, summarise


def exact_p(differences):
    """Two-sided p by counting all ways to give the ranks signs."""
    ranks = np.argsort(np.argsort(np.abs(differences))) + 1
    seen = ranks[np.array(differences) > 0].sum()
    sums = np.array([np.dot(signs, ranks) for signs in product((0, 1), repeat=len(ranks))])
    return min(1.0, 2 * min((sums <= seen).mean(), (sums >= seen).mean()))


@pytest.mark.parametrize("seed", range(5))
def test_the_p_value_is_that_of_counting_all_signs(seed):
    rng = np.random.default_rng(seed)
    raw = rng.uniform(0, 10, 8)
    refined = raw - rng.normal(0.5, 1, 8)
    assert compare(raw, refined).p == pytest.approx(exact_p(refined - raw))
    assert compare(refined, raw).p == pytest.approx(exact_p(refined - raw))


def test_frames_without_a_difference_are_left_out():
    raw = np.arange(9.0)
    refined = raw - [0, 1.5, -0.25, 2, 3, 0, 4, 0.5, 0]
    differing = [1.5, -0.25, 2, 3, 4, 0.5]
    assert compare(raw, refined).p == pytest.approx(exact_p(differing))


def test_where_nothing_changed_there_is_no_p_value():
    assert compare([1, 2, 3, 4, 5, 6, 7], [1, 2, 3, 4, 5, 6, 7]) == (None, "no frame differs")


def test_five_frames_are_too_few():
    test = compare([1, 2, 3, 4, 5, 6, 7], [0.9, 1.8, 2.7, 3.6, 4.5, 6, 7])
    assert test.p is None
    assert test.why == "fewer than 6 frames differ, so no p-value can be below 0.05"
    assert compare([1, 2, 3, 4, 5, 6], [0.9, 1.8, 2.7, 3.6, 4.5, 5.4]).p == pytest.approx(2 / 2**6)


def test_the_deviation_is_that_of_a_sample():
    assert summarise([1, 2, 6]) == (3, pytest.approx(7**0.5))
    assert summarise([4.5]) == (4.5, None)
