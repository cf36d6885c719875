"""What the scores of many cases come to, per group and method."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import fmean, median

import numpy as np

from stereomend.bench.quality_cases import QualityCase
from stereomend.bench.quality_methods import INPUT
from stereomend.bench.quality_scores import Scored

WORSE = 1.05
"""Over this ratio a case was made worse ..."""
WORSE_PX = 0.01
"""... if its RMSE grew by more than this as well [px]: an exact map has no ratio."""


@dataclass(frozen=True)
class Summary:
    """One method on all cases of a group; means are arithmetic but that of ratios. None: nothing counts."""

    group: str
    method: str
    cases: int
    ratio: float
    """Geometric mean of RMSE / the input's RMSE; of an exact input the RMSE itself, px."""
    worst: float
    """The largest of these."""
    worse: int
    """Cases made worse, by more than 5 % and 0.01 px."""
    rmse: float
    """Mean, px."""
    visible_rmse: float | None
    """Mean where the right camera sees the point too, px."""
    occluded_rmse: float | None
    """Mean where it does not, px."""
    bad3: float
    """Mean, percent."""
    edge_bad3: float | None
    """Mean over cases with an instrument, percent."""
    ms: float
    """Median; images of all sizes."""


def summarise(scored: Sequence[Scored]) -> list[Summary]:
    """One line per group and method, in the order of their first cases; each case has a score of `INPUT`."""
    before = {one.case: one.rmse for one in scored if one.method == INPUT}
    groups = dict.fromkeys(one.case.group for one in scored)
    methods = dict.fromkeys(one.method for one in scored)
    return [
        _summary([one for one in scored if (one.case.group, one.method) == (group, method)], before)
        for group in groups
        for method in methods
    ]


def _summary(scored: Sequence[Scored], before: dict[QualityCase, float]) -> Summary:
    ratios = [one.rmse / (before[one.case] or 1.0) for one in scored]
    return Summary(
        group=scored[0].case.group,
        method=scored[0].method,
        cases=len(scored),
        ratio=geometric_mean(ratios),
        worst=max(ratios),
        worse=sum(_made_worse(one.rmse, before[one.case]) for one in scored),
        rmse=fmean(one.rmse for one in scored),
        visible_rmse=_mean(one.visible_rmse for one in scored),
        occluded_rmse=_mean(one.occluded_rmse for one in scored),
        bad3=fmean(one.bad3 for one in scored),
        edge_bad3=_mean(one.edge_bad3 for one in scored),
        ms=median(one.ms for one in scored),
    )


def _made_worse(after: float, before: float) -> bool:
    return after > max(WORSE * before, before + WORSE_PX)


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return fmean(known) if known else None


def geometric_mean(values: Sequence[float]) -> float:
    """Of numbers of at least 0; 0 if one of them is (where `statistics.geometric_mean` may refuse)."""
    with np.errstate(divide="ignore"):
        return float(np.exp(np.mean(np.log(values))))
