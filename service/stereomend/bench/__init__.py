"""The benchmark: how fast this machine refines, against what its memory and multipliers could do."""

from stereomend.bench.run import Plan, Report, as_json, plan_of, run_bench
from stereomend.bench.tables import lines_of

__all__ = ["Plan", "Report", "as_json", "lines_of", "plan_of", "run_bench"]
