"""What the ledger answers, besides records."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from stereomend.jobs.records import Claim, JobRecord, JobState


class Accepted(NamedTuple):
    """A job that will not be lost."""

    record: JobRecord
    replayed: bool = False
    """Whether it was accepted before, under the same idempotency key."""
    claim: Claim | None = None
    """Where it was accepted as running."""


class Page(NamedTuple):
    """Records, newest first."""

    records: list[JobRecord]
    next_cursor: str | None
    """Of the page after this one; None: there is none."""


class Renewal(NamedTuple):
    """What a worker learns when it renews its lease."""

    held: bool
    """False: the claim was lost; whatever the worker does now is for nothing."""
    cancel_requested: bool


class Reaped(NamedTuple):
    """Ids of the jobs that were taken from workers or had waited too long."""

    queued: list[str]
    """Of those to be run again."""
    ended: list[str]
    """Of those that failed or were cancelled."""
    blobs: list[str]
    """Names to delete: inputs of ended ones."""


class Stats(NamedTuple):
    """How full the ledger is."""

    counts: Mapping[JobState, int]
    """Of all states."""
    oldest_queued_s: float
    """Age of the job that waits longest [s]; 0: none waits."""
    bytes_held: int
    """Of inputs."""
    bytes_reserved: int
    """For results to come."""
