"""What the ledger knows of a job, as plain data."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from typing import Any, NamedTuple

MOST_CRASHES = 3
"""A job whose workers died this often is poison and fails."""


class JobState(StrEnum):
    """queued -> running -> succeeded | failed | cancelled; succeeded, with the result gone: expired."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"
    EXPIRED = "expired"

    @property
    def final(self) -> bool:
        """Whether nothing more will be computed."""
        return self not in (JobState.QUEUED, JobState.RUNNING)


class Progress(NamedTuple):
    """How far a running job is."""

    phase: str
    """A key of `TIMINGS`: `queue`, `decode`, `initial`, `ldr`, `gdr` or `encode`."""
    done: int = 0
    total: int = 0
    """Steps of the phase; 0: unknown."""


def is_job_id(text: str) -> bool:
    """Whether a text can be the id of a job."""
    return re.fullmatch(r"[0-9a-f]{32}", text) is not None


def inputs_blob(id: str) -> str:
    """Name the blob that holds a job's files."""
    return f"inputs/{id}"


def result_blob(id: str, attempt: int) -> str:
    """Name the blob that the `attempt`-th worker of a job writes: a late one never meets another's."""
    return f"results/{id}.{attempt}"


@dataclass(frozen=True)
class NewJob:
    """A job to be accepted, its blob of inputs stored under `id`."""

    id: str
    """32 hexadecimal digits."""
    owner: str
    """The id of the key that sent it; `local` where there are none."""
    preset: str
    params: Mapping[str, Any]
    """As JSON; all that `RefineParams` holds."""
    input: Mapping[str, Any]
    """`width`, `height` [px] and `sha256` of the body's parts."""
    bytes_held: int
    """Of the blob of inputs."""
    bytes_reserved: int
    """Room that the result may need."""
    priority: int = 0
    """Larger ones run first; among equals the oldest."""
    deadline: datetime | None = None
    keep_inputs: bool = False
    idempotency_key: str | None = None
    request_id: str = "-"
    traceparent: str | None = None
    """As `Task.traceparent`."""


@dataclass(frozen=True)
class JobRecord:
    """A job; times are UTC and aware."""

    id: str
    owner: str
    state: JobState
    version: int
    """Grows with every change."""
    preset: str
    params: Mapping[str, Any]
    input: Mapping[str, Any]
    priority: int
    attempt: int
    """The fencing token: how often it was claimed."""
    progress: Progress
    cancel_requested: bool
    keep_inputs: bool
    request_id: str
    created_at: datetime
    deadline: datetime | None = None
    started_at: datetime | None = None
    finished_at: datetime | None = None
    expires_at: datetime | None = None
    """When its result goes, once it has one."""
    backend: str | None = None
    device: str | None = None
    timings_ms: Mapping[str, float] = field(default_factory=dict)
    quality: Mapping[str, Any] | None = None
    meta: Mapping[str, Any] | None = None
    """All that is told of the result; `quality` is a part of it."""
    result_blob: str | None = None
    result_sha256: str | None = None
    error: Mapping[str, str] | None = None
    """`slug` and `detail`."""


@dataclass(frozen=True)
class Claim:
    """The right to work on a job until its lease ends; what comes later is refused by `attempt`."""

    id: str
    attempt: int
    params: Mapping[str, Any]
    keep_inputs: bool
    request_id: str
    created_at: datetime
    traceparent: str | None = None


@dataclass(frozen=True)
class Outcome:
    """How an attempt ended: with a result, or with an error."""

    backend: str | None = None
    device: str | None = None
    timings_ms: Mapping[str, float] = field(default_factory=dict)
    meta: Mapping[str, Any] | None = None
    result_blob: str | None = None
    result_sha256: str | None = None
    error: Mapping[str, str] | None = None
    """`slug` and `detail`; None where there is a result. `job-cancelled` makes the job cancelled."""


@dataclass(frozen=True)
class Room:
    """What may wait and run at once, checked in the transaction that accepts."""

    most_jobs: int
    most_bytes: int
    most_jobs_of_owner: int
    free_disk_bytes: int
    """Free on the disk of the blobs now, less what must stay free; reservations are taken from it."""
