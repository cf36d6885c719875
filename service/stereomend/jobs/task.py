"""One refinement from encoded files to an encoded answer, in whatever process it runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

from stereomend.codec import decode_disparity, decode_image, encode_result
from stereomend.disparity import DisparityMap, RefinementResult, StereoPair, check_same_size
from stereomend.refinement import Backend, RefineParams, run

TIMINGS = ("queue", "decode", "initial", "ldr", "gdr", "encode", "total")
"""The keys of `Answer.timings`, in the order in which time passes."""


@dataclass(frozen=True)
class Files:
    """Encoded files as they came."""

    left: bytes
    right: bytes
    disparity: bytes | None

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return len(self.left) + len(self.right) + len(self.disparity or b"")


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


def perform(task: Task, backend: Backend, max_pixels: int) -> Answer:
    """Decode, refine and encode.

    Raises:
        InputError: as `refine_files`.
        DisparityOutOfRange: the result does not fit the media type.
    """
    result = refine_files(task, task.params, backend, max_pixels)
    began = perf_counter()
    body = encode_result(result, task.media_type, task.params.outputs)
    encode = 1e3 * (perf_counter() - began)
    timings = result.timings | {"encode": encode, "total": result.timings["total"] + encode}
    return Answer(body, task.media_type, result.meta, timings)


def refine_files(files: Files, params: RefineParams, backend: Backend, max_pixels: int) -> RefinementResult:
    """Decode and refine; the result's timings have all keys of `TIMINGS`.

    Raises:
        UnknownFormat, DamagedFile, TooManyPixels: a file cannot be used.
        ShapeMismatch: the images or the disparity map differ in height or width.
        InvalidParameter, NoValidDisparity: the parameters do not fit the files.
    """
    began = perf_counter()
    pair, upload = _decode(files, params.disparity_scale, max_pixels)
    decoded = perf_counter()
    result = run(pair, upload, params, backend)
    spent = {"decode": 1e3 * (decoded - began), "total": 1e3 * (perf_counter() - began)}
    known = result.timings | spent
    return replace(result, timings={name: known.get(name, 0.0) for name in TIMINGS})


def _decode(files: Files, scale: float | None, max_pixels: int) -> tuple[StereoPair, DisparityMap | None]:
    left = decode_image(files.left, "left", max_pixels)
    pair = StereoPair(left, decode_image(files.right, "right", max_pixels))
    if files.disparity is None:
        return pair, None
    upload = decode_disparity(files.disparity, "disparity", max_pixels, scale)
    check_same_size("disparity", upload.shape, "left", pair.shape)
    return pair, upload
