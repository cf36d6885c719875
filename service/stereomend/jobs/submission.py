"""What a client sends to be refined, and the job that becomes of it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from uuid import uuid4

from stereomend.codec import image_size
from stereomend.errors import IdempotencyInFlight
from stereomend.jobs.blobs import pack
from stereomend.jobs.records import NewJob
from stereomend.jobs.task import Files
from stereomend.refinement import RefineParams

_BYTES_PER_PIXEL = 4 + 4 + 1 + 4
"""Of a stored result: disparity, confidence, provenance, input_confidence."""
_BYTES_OF_DEPTH = 4 + 3
"""And depth and colours, where calibrated."""
_BYTES_OF_META = 1 << 16


@dataclass(frozen=True)
class Submission:
    """What is to be refined, for whom, and how."""

    files: Files
    params: RefineParams
    owner: str
    """The id of a key; `local` where there are none."""
    request_id: str = "-"
    priority: int = 0
    deadline_s: float | None = None
    """Seconds from now after which it need not be begun any more."""
    keep_inputs: bool = False
    idempotency_key: str | None = None


def new_job(submission: Submission, max_pixels: int) -> tuple[NewJob, list[bytes]]:
    """Describe the job and lay out the blob of its inputs; reads the header of the left image, and all bytes.

    Raises:
        UnknownFormat, DamagedFile, TooManyPixels: the left image cannot be used.
    """
    files, params = submission.files, submission.params
    width, height = image_size(files.left, "left", max_pixels)
    chunks, deadline_s = pack(files), submission.deadline_s
    digest = hashlib.sha256()
    for chunk in chunks:
        digest.update(chunk)
    per_pixel = _BYTES_PER_PIXEL + (_BYTES_OF_DEPTH if params.calibrated else 0)
    job = NewJob(
        id=uuid4().hex,
        owner=submission.owner,
        preset=params.preset,
        params=params.model_dump(mode="json"),
        input={"width": width, "height": height, "sha256": digest.hexdigest()},
        bytes_held=sum(map(len, chunks)),
        bytes_reserved=width * height * per_pixel + _BYTES_OF_META,
        priority=submission.priority,
        deadline=None if deadline_s is None else datetime.now(UTC) + timedelta(seconds=deadline_s),
        keep_inputs=submission.keep_inputs,
        idempotency_key=submission.idempotency_key,
        request_id=submission.request_id,
    )
    return job, chunks


class Alone:
    """Keeps a second submission with the same idempotency key out while the first is being taken in."""

    def __init__(self, in_flight: set[tuple[str, str]], submission: Submission) -> None:
        self._in_flight = in_flight
        key = submission.idempotency_key
        self._mine = None if key is None else (submission.owner, key)

    def __enter__(self) -> None:
        if self._mine in self._in_flight:
            error = IdempotencyInFlight("a request with this idempotency key is still being taken in")
            error.retry_after = 1
            raise error
        if self._mine is not None:
            self._in_flight.add(self._mine)

    def __exit__(self, *_: object) -> None:
        if self._mine is not None:
            self._in_flight.discard(self._mine)
