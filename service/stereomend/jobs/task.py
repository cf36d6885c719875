"""One refinement from encoded files to an encoded answer, in whatever process it runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cache
from time import perf_counter
from typing import Any, NamedTuple, TypeVar

from stereomend.codec import decode_disparity, decode_image, decode_mask, encode_result, holds_confidences
from stereomend.disparity import DisparityMap, Image, RefinementResult, StereoPair, check_same_size
from stereomend.refinement import Backend, RefineParams, run

T = TypeVar("T")

TIMINGS = ("queue", "decode", "initial", "ldr", "gdr", "encode", "total")
"""The keys of `Answer.timings`, in the order in which time passes."""


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


@dataclass(frozen=True)
class Answer:
    """An encoded result, what is known about it, and the milliseconds of each of `TIMINGS`."""

    body: bytes
    media_type: str
    meta: Mapping[str, Any]
    timings: dict[str, float]


class Refined(NamedTuple):
    """A result, and the left image that a point cloud takes its colours from."""

    result: RefinementResult
    left: Image


def perform(task: Task, backend: Backend, max_pixels: int) -> Answer:
    """Decode, refine and encode.

    Raises:
        InputError: as `refine_files`.
        InvalidParameter: a point cloud without a calibration.
        DisparityOutOfRange: the result does not fit the media type.
    """
    confidences = holds_confidences(task.media_type)
    result, left = refine_files(task, task.params, backend, max_pixels, confidences)
    began = perf_counter()
    body = encode_result(result, task.media_type, task.params.outputs, left)
    encode = 1e3 * (perf_counter() - began)
    timings = result.timings | {"encode": encode, "total": result.timings["total"] + encode}
    return Answer(body, task.media_type, result.meta, timings)


def refine_files(
    files: Files, params: RefineParams, backend: Backend, max_pixels: int, confidences: bool = True
) -> Refined:
    """Decode and refine; the result's timings have all keys of `TIMINGS`, `confidences` as of `run`.

    Raises:
        UnknownFormat, DamagedFile, TooManyPixels: a file cannot be used.
        ShapeMismatch: the images, the disparity map or the mask differ in height or width.
        InvalidParameter, NoValidDisparity: the parameters do not fit the files.
    """
    began = perf_counter()
    pair, upload = _decode(files, params.disparity_scale, max_pixels)
    decoded = perf_counter()
    result = run(pair, upload, params, backend, confidences)
    spent = {"decode": 1e3 * (decoded - began), "total": 1e3 * (perf_counter() - began)}
    known = result.timings | spent
    return Refined(replace(result, timings={name: known.get(name, 0.0) for name in TIMINGS}), pair.left)


def _decode(files: Files, scale: float | None, max_pixels: int) -> tuple[StereoPair, DisparityMap | None]:
    # Side by side: nearly all of the time goes to inflating, which holds no lock. Errors come in this order.
    def begin(decode: Callable[..., T], file: bytes | None, *args: Any) -> Future[T] | None:
        return None if file is None else _decoders().submit(decode, file, *args)

    right = _decoders().submit(decode_image, files.right, "right", max_pixels)
    mask = begin(decode_mask, files.mask, "mask", max_pixels)
    upload = begin(decode_disparity, files.disparity, "disparity", max_pixels, scale)
    left = decode_image(files.left, "left", max_pixels)
    pair = StereoPair(left, right.result(), mask.result() if mask else None)
    if upload is None:
        return pair, None
    check_same_size("disparity", upload.result().shape, "left", pair.shape)
    return pair, upload.result()


@cache
def _decoders() -> ThreadPoolExecutor:
    # Kept, for to start and end three threads takes longer than to decode an image.
    return ThreadPoolExecutor(3, "decode")
