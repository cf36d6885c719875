"""The benchmark: how fast this machine refines, and how good the refined maps are."""

from stereomend.bench.quality import quality_as_json, quality_plan_of, run_quality
from stereomend.bench.quality_tables import quality_lines_of
from stereomend.bench.run import Plan, Report, as_json, plan_of, run_bench
from stereomend.bench.tables import lines_of

__all__ = [
    "Plan",
    "Report",
    "as_json",
    "lines_of",
    "plan_of",
    "quality_as_json",
    "quality_lines_of",
    "quality_plan_of",
    "run_bench",
    "run_quality",
]
