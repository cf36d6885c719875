"""Score every method's maps on every frame, as they are and refined."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from stereomend.disparity import DisparityMap, FloatMap, Mask, StereoPair
from stereomend.errors import InputError
from stereomend.evaluation.files import Reader
from stereomend.evaluation.frame import Entry, Frame
from stereomend.evaluation.metrics import depth_rmse, score
from stereomend.evaluation.predictions import Method
from stereomend.refinement import Backend, RefineParams, parse_params, run

RAW = "raw"
"""The name of a method's map as it came."""
ALL, VISIBLE = "all", "visible"
"""Regions: every pixel with a truth, and those that the right camera sees too."""

Values = Mapping[str, float]
"""From the key of a measure (`tables.MEASURES`), `pixels` or `missing_percent` to its value."""
Maps = dict[str, FloatMap]
"""From the name of a variant to its disparity map, (H, W) px."""


@dataclass(frozen=True)
class Row:
    """One frame, method and variant."""

    frame: str
    method: str
    variant: str
    """`RAW`, or what refined it, such as `paper` or `paper ldr+gdr`."""
    regions: Mapping[str, Values]
    """By `ALL` and, where the dataset knows what is hidden, `VISIBLE`."""


@dataclass(frozen=True)
class Plan:
    """What to evaluate."""

    entries: Sequence[Entry]
    methods: Sequence[Method]
    variants: Mapping[str, RefineParams]
    backend: Backend
    read: Reader


Watch = Callable[[str, str, Frame, Maps], None]
"""Called once per frame and method, with both names, the frame and all maps."""


def plan_variants(presets: Sequence[str], stages: Sequence[Sequence[str]]) -> dict[str, RefineParams]:
    """Combine presets and stages, by name; no stages: both (raises InvalidParameter for unknown ones)."""
    variants = {}
    for preset in presets:
        for some in stages or [()]:
            given = {"stages": list(some)} if some else {}
            name = f"{preset} {'+'.join(some)}" if some else preset
            variants[name] = parse_params({"preset": preset, **given})
    return variants


def evaluate(plan: Plan, watch: Watch) -> Iterator[Row]:
    """Score frame by frame, since all of them may not fit into memory.

    Raises:
        InputError: a file cannot be used, or a frame has no pixel to count; its message names the frame.
    """
    for entry in plan.entries:
        try:
            yield from _rows(entry, plan, watch)
        except InputError as error:
            raise type(error)(f"{entry.name}: {error}") from error


def _rows(entry: Entry, plan: Plan, watch: Watch) -> Iterator[Row]:
    frame = entry.load().check()
    for method in plan.methods:
        prediction = plan.read.disparity(method.files[entry.name])
        maps = {RAW: prediction} | _refined(frame, prediction, plan)
        watch(entry.name, method.name, frame, maps)
        for variant, disparity in maps.items():
            yield Row(entry.name, method.name, variant, _regions(disparity, frame))


def _refined(frame: Frame, prediction: FloatMap, plan: Plan) -> Maps:
    pair, upload = StereoPair(frame.left, frame.right), DisparityMap(prediction)
    return {name: run(pair, upload, params, plan.backend).disparity for name, params in plan.variants.items()}


def _regions(disparity: FloatMap, frame: Frame) -> dict[str, Values]:
    regions = {ALL: _values(disparity, frame, None)}
    if frame.visible is not None:
        regions[VISIBLE] = _values(disparity, frame, frame.visible)
    return regions


def _values(disparity: FloatMap, frame: Frame, counted: Mask | None) -> Values:
    scores = score(disparity, frame.truth, counted)
    values = {"rmse_px": scores.rmse, "epe_px": scores.epe}
    values |= {f"bad{limit:g}_percent": share for limit, share in scores.bad.items()}
    if frame.calibration is not None:
        values["depth_rmse_mm"] = depth_rmse(disparity, frame.truth, frame.calibration, counted)
    return values | {"missing_percent": scores.missing, "pixels": scores.pixels}
