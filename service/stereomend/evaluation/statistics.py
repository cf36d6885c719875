"""What a measure says over all frames, and whether refinement changed it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import wilcoxon

LEAST_PAIRS = 6
"""With n differing pairs no p-value is below 2 / 2^n: 0.0625 for five."""


class Summary(NamedTuple):
    """Of one measure over the frames."""

    mean: float
    deviation: float | None
    """Standard deviation of the frames (divisor n - 1); None for a single frame."""


class Comparison(NamedTuple):
    """The outcome of a test whether refinement made a difference."""

    p: float | None
    why: str = ""
    """Why there is no p-value."""


def summarise(values: Sequence[float]) -> Summary:
    """Take one value per frame, at least one."""
    deviation = float(np.std(values, ddof=1)) if len(values) > 1 else None
    return Summary(float(np.mean(values)), deviation)


def compare(raw: Sequence[float], refined: Sequence[float]) -> Comparison:
    """Wilcoxon's signed-rank test, two-sided, of values that belong together frame by frame.

    Frames without a difference are left out, as Wilcoxon did. The distribution is exact up to 50 frames
    without ties, approximately normal otherwise, by `scipy.stats.wilcoxon`.
    """
    differences = np.subtract(refined, raw)
    differing = int(np.count_nonzero(differences))
    if differing == 0:
        return Comparison(None, "no frame differs")
    if differing < LEAST_PAIRS:
        return Comparison(None, f"fewer than {LEAST_PAIRS} frames differ, so no p-value can be below 0.05")
    return Comparison(float(wilcoxon(differences[differences != 0]).pvalue))
