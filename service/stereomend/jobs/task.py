"""One refinement from encoded files to an encoded answer, in whatever process it runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import cache
from time import perf_counter
from typing import Any, NamedTuple, TypeVar

from stereomend.codec import (
    STORED_TYPE,
    decode_disparity,
    decode_image,
    decode_mask,
    encode_map,
    encode_result,
    encode_stored,
    holds_confidences,
)
from stereomend.disparity import DisparityMap, Image, RefinementResult, StereoPair
from stereomend.jobs.helpers import Helpers
from stereomend.refinement import (
    COPIES,
    Backend,
    Mended,
    RefineParams,
    Watch,
    describe,
    mend,
    prepare,
    unwatched,
)

T = TypeVar("T")

TIMINGS = ("queue", "decode", "prepare", "initial", "ldr", "gdr", "finish", "encode", "total")
"""The keys of `Answer.timings`, as time passes.

`decode` and `encode` are what was waited for them. `prepare` brings the pair to working size; `finish` brings
the map back to that of the input and tells of it.
"""


@dataclass(frozen=True)
class Files:
    """Encoded files as they came."""

    left: bytes
    right: bytes
    disparity: bytes | None
    mask: bytes | None = field(default=None, kw_only=True)

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(len(file or b"") for file in (self.left, self.right, self.disparity, self.mask))


@dataclass(frozen=True)
class Task(Files):
    """Files, checked parameters, and the media type of the answer."""

    params: RefineParams
    media_type: str
    request_id: str = "-"
    """For log lines."""
    traceparent: str | None = None
    """Of W3C Trace Context: the span that the stages belong to."""


@dataclass(frozen=True)
class Answer:
    """An encoded result, what is known about it, and the milliseconds of `TIMINGS` and maybe `COPIES`."""

    body: bytes
    media_type: str
    meta: Mapping[str, Any]
    timings: dict[str, float]


class Refined(NamedTuple):
    """A result, and the left image that a point cloud takes its colours from."""

    result: RefinementResult
    left: Image


def perform(task: Task, backend: Backend, max_pixels: int, watch: Watch = unwatched) -> Answer:
    """Decode, refine and encode; a map that is all of the answer is written while it is described.

    Raises:
        InputError: as `refine_files`, and what `watch` raises.
        InvalidParameter: a point cloud without a calibration.
        DisparityOutOfRange: the result does not fit the media type.
    """
    began = perf_counter()
    watch("decode", 0, 0)
    mended, left = _mended(task, task.params, (backend, max_pixels), watch)
    watch("encode", 0, 0)
    whole = holds_confidences(task.media_type)
    early = None if whole else _helper().start(encode_map, mended.disparity, task.media_type)
    result = _described(mended, task.params, backend, began, whole)
    described = perf_counter()
    body = early.result() if early else _whole(result, task, left)
    ended = perf_counter()
    timings = result.timings | {"encode": 1e3 * (ended - described), "total": 1e3 * (ended - began)}
    return Answer(body, task.media_type, result.meta, timings)


def refine_files(files: Files, params: RefineParams, backend: Backend, max_pixels: int) -> Refined:
    """Decode and refine; the result's timings have all keys of `TIMINGS`.

    Raises:
        UnknownFormat, DamagedFile, TooManyPixels: a file cannot be used.
        ShapeMismatch: the images, the disparity map or the mask differ in height or width.
        InvalidParameter, NoValidDisparity: the parameters do not fit the files.
    """
    began = perf_counter()
    mended, left = _mended(files, params, (backend, max_pixels))
    return Refined(_described(mended, params, backend, began), left)


def _whole(result: RefinementResult, task: Task, left: Image) -> bytes:
    if task.media_type == STORED_TYPE:
        return encode_stored(result, left, task.params.outputs)
    return encode_result(result, task.media_type, task.params.outputs, left)


def _mended(
    files: Files, params: RefineParams, means: tuple[Backend, int], watch: Watch = unwatched
) -> tuple[Mended, Image]:
    (backend, max_pixels), began = means, perf_counter()
    pair, upload = _begin_decode(files, params.disparity_scale, max_pixels)
    prepared = prepare(pair, params, backend.alone if upload else backend)
    disparity = upload.result() if upload else None
    decode = 1e3 * (perf_counter() - began) - prepared.took_ms
    mended = mend(prepared, disparity, params, backend, watch)
    return mended._replace(timings=mended.timings | {"decode": decode}), pair.left


def _described(
    mended: Mended, params: RefineParams, backend: Backend, began: float, confidences: bool = True
) -> RefinementResult:
    result = describe(mended, params, backend, confidences)
    known = result.timings | {"total": 1e3 * (perf_counter() - began)}
    copies = {name: known[name] for name in COPIES if name in known}
    return replace(result, timings={name: known.get(name, 0.0) for name in TIMINGS} | copies)


def _begin_decode(
    files: Files, scale: float | None, max_pixels: int
) -> tuple[StereoPair, Future[DisparityMap] | None]:
    """The pair, and the disparity map as soon as it is decoded, which the pair is prepared without."""

    # Nearly all of the time goes to inflating, which holds no lock. One helper, so that the pair comes first.
    def begin(decode: Callable[..., T], file: bytes | None, *args: Any) -> Future[T] | None:
        return None if file is None else _helper().start(decode, file, *args)

    right = _helper().start(decode_image, files.right, "right", max_pixels)
    mask = begin(decode_mask, files.mask, "mask", max_pixels)
    upload = begin(decode_disparity, files.disparity, "disparity", max_pixels, scale)
    left = decode_image(files.left, "left", max_pixels)
    return StereoPair(left, right.result(), mask.result() if mask else None), upload


@cache
def _helper() -> Helpers:
    return Helpers(1)
