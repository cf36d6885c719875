"""What each part of the preset `robust` brings, and how much each of its constants matters, on phantoms.

    python benchmarks/robust_parts.py [--seed 1] [--scenes 14]            # leave one part out
    python benchmarks/robust_parts.py --sweep [--seed 1] [--scenes 14]    # each constant a third down and up

Prints per group the geometric mean of RMSE / RMSE of the input (of exact inputs the RMSE in px).
"""

import argparse
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

from stereomend.bench.quality_cases import plan_cases
from stereomend.bench.quality_methods import INPUT, Method
from stereomend.bench.quality_scores import score_map
from stereomend.bench.quality_summary import summarise
from stereomend.errors import InvalidParameter
from stereomend.refinement import PRESETS, parse_params, select_backend
from stereomend.refinement.params import RefineParams
from stereomend.refinement.pipeline import run

PARTS: Mapping[str, Mapping[str, Any]] = {
    "complete": {},
    "half size": {"processing_scale": 0.5},
    "R1 confidence of the paper": {"ldr": {"method": "smoothness", "min_confidence": 0.5}},
    "R2 no occlusion filled": {"ldr": {"occlusion_stretch": 0.0, "occlusion_slack": 0.0}},
    "R3 no prior": {"gdr": {"prior_weight": 0.0, "fill_weight": 0.0}},
    "R4 no edge weights": {"gdr": {"edge_level": None}},
    "R5 hidden pixels count": {"gdr": {"observed_only": False}},
    "R5 no averaging": {"gdr": {"averaging_px": 0.0}},
    "R6 the base is not reused": {"gdr": {"reuse_margin": None}},
    "R7 nothing bent": {"fusion": {"bend": 0.0}},
    "R7 to R10 no fusion": {"fusion": {"enabled": False}},
}


def constants() -> Iterator[tuple[str, str, float]]:
    """Group, name and value of every number of the preset that is not 0."""
    preset = PRESETS["robust"]
    for group in ("ldr", "gdr", "fusion"):
        for name, value in getattr(preset, group).model_dump().items():
            if isinstance(value, int | float) and not isinstance(value, bool) and value:
                yield group, name, value


def thirds() -> Mapping[str, Mapping[str, Any]]:
    """Every constant a third down and up, as far as its range allows."""
    changes: dict[str, Mapping[str, Any]] = {"complete": {}}
    for group, name, value in constants():
        for factor in (2 / 3, 4 / 3):
            changed = type(value)(round(value * factor, 9))
            given = {group: {name: changed}}
            if changed != value and _allowed(given):
                changes[f"{group}.{name} {value:g} -> {changed:g}"] = given
    return changes


def _allowed(given: Mapping[str, Any]) -> bool:
    try:
        parse_params({"preset": "robust", **given})
    except InvalidParameter:
        return False
    return True


def method_of(params: RefineParams) -> Method:
    """Refine with these parameters."""
    backend = select_backend("auto")
    return lambda pair, upload: run(pair, upload, params, backend).disparity


def ratios(variants: Mapping[str, Mapping[str, Any]], seed: int, scenes: int) -> dict[str, dict[str, float]]:
    """Per variant and group the geometric mean of RMSE / RMSE of the input."""
    methods = {
        name: method_of(parse_params({"preset": "robust", **given})) for name, given in variants.items()
    }
    scored = []
    for case in plan_cases(seed, scenes):
        phantom = case.phantom()
        upload = case.upload(phantom)
        score = partial(score_map, case)
        scored.append(score(INPUT, upload.values, phantom, 0.0))
        scored += [
            score(name, method(phantom.pair, upload), phantom, 0.0) for name, method in methods.items()
        ]
        print(".", end="", flush=True)
    print()
    found: dict[str, dict[str, float]] = {name: {} for name in methods}
    for one in summarise(scored):
        if one.method in found:
            found[one.method][one.group] = one.ratio
    return found


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--sweep", action="store_true")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--scenes", type=int, default=14)
    given = options.parse_args()
    found = ratios(thirds() if given.sweep else PARTS, given.seed, given.scenes)
    groups, complete = list(found["complete"]), found["complete"]
    print(f"{'':44s}" + "".join(f"{group:>16s}" for group in groups))
    for name, row in found.items():
        cells = (f"{row[group]:8.3f} {100 * (row[group] / complete[group] - 1):+6.1f}%" for group in groups)
        print(f"{name:44s}" + "".join(cells))


if __name__ == "__main__":
    main()
