"""The quality report as a table for a terminal of 100 columns."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

from stereomend.bench.machine import machine_lines
from stereomend.bench.quality import QualityPlan, QualityReport
from stereomend.bench.quality_summary import Summary
from stereomend.bench.tables import or_dash


def quality_lines_of(report: QualityReport) -> Iterator[str]:
    """The table, line by line."""
    plan = report.plan
    yield from machine_lines(report.machine)
    yield f"{plan.scenes} cases of base seed {plan.seed} in {report.seconds:.0f} s{_told(plan)}"
    yield ""
    yield (
        f"{'group':20s}{'method':12s}{'ratio':>8s}{'worst':>7s}{'worse':>6s}"
        f"{'RMSE':>8s}{'visible':>8s}{'hidden':>8s}{'bad-3':>7s}{'edge':>7s}{'ms':>7s}"
    )
    for _, group in groupby(report.summaries, key=lambda one: one.group):
        for number, one in enumerate(group):
            yield _row(one, f"{one.group} ({one.cases})" if number == 0 else "")
        yield ""
    yield "ratio: geometric mean of RMSE / RMSE of the input, which counts its unknown pixels as 0;"
    yield "where the input is exact: RMSE in px. worse: cases made worse by over 5 %. RMSE, visible, hidden:"
    yield "means, px. bad-3: % of pixels off by over 3 px; edge: the same within 5 px of the shaft's edge."


def _told(plan: QualityPlan) -> str:
    changes = [
        f"{stage}.{name}={value}" for stage, of in plan.overrides.items() for name, value in of.items()
    ]
    return f", all presets with {' '.join(changes)}" if changes else ""


def _row(one: Summary, title: str) -> str:
    return (
        f"{title:20s}{one.method:12s}{one.ratio:8.3f}{one.worst:7.2f}{one.worse:6d}"
        f"{one.rmse:8.3f}{or_dash(one.visible_rmse, '8.3f')}{or_dash(one.occluded_rmse, '8.3f')}"
        f"{one.bad3:7.2f}{or_dash(one.edge_bad3, '7.2f')}{one.ms:7.0f}"
    )
