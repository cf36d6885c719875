"""Rows of `jobs`: as records and claims, and what each change of state sets."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import Connection, and_, insert, or_, select, update
from sqlalchemy.sql import ColumnElement

from stereomend.jobs.ledger.schema import jobs
from stereomend.jobs.records import (
    MOST_CRASHES,
    Claim,
    JobRecord,
    JobState,
    NewJob,
    Outcome,
    Progress,
    inputs_blob,
    result_blob,
)

JobRow = Any
"""A row of `jobs`: its columns are attributes."""
Values = dict[str, Any]
"""Of columns, by name."""

LIVE = jobs.c.state.in_([JobState.QUEUED, JobState.RUNNING])
"""Waits or runs."""
_QUEUED, _DECODE = Progress("queue"), Progress("decode")


def record_of(row: JobRow) -> JobRecord:
    """What a client may know of a row."""
    known = {name: getattr(row, name) for name in _SHARED}
    return JobRecord(
        **known,
        state=JobState(row.state),
        progress=Progress(row.phase, row.phase_done, row.phase_total),
        timings_ms=row.timings_ms or {},
        quality=(row.meta or {}).get("quality"),
    )


_SHARED = JobRecord.__dataclass_fields__.keys() - {"state", "progress", "timings_ms", "quality"}


def claim_of(row: JobRow) -> Claim:
    """What a worker needs to know of a row."""
    return Claim(**{name: getattr(row, name) for name in Claim.__dataclass_fields__})


def insert_job(connection: Connection, job: NewJob, now: datetime) -> JobRow:
    """Add a job that waits."""
    given = {name: getattr(job, name) for name in NewJob.__dataclass_fields__}
    given |= {"params": dict(job.params), "input": dict(job.input), "created_at": now}
    started = {"version": 1, "attempt": 0, "crashes": 0, "cancel_requested": False}
    values = given | started | queued()
    return connection.execute(insert(jobs).values(values).returning(*jobs.c)).one()


def change(connection: Connection, which: ColumnElement[bool], values: Values) -> JobRow | None:
    """Set values in at most one row, and its version; returns the row as it is then."""
    statement = update(jobs).where(which).values(**values, version=jobs.c.version + 1)
    return connection.execute(statement.returning(*jobs.c)).one_or_none()


def held(claim: Claim) -> ColumnElement[bool]:
    """Whether the claim is still the job's: the fence that a late worker does not pass."""
    return and_(jobs.c.id == claim.id, jobs.c.attempt == claim.attempt, jobs.c.state == JobState.RUNNING)


def claimable(now: datetime) -> ColumnElement[bool]:
    """Whether a job waits and may run now."""
    return and_(
        jobs.c.state == JobState.QUEUED,
        or_(jobs.c.not_before.is_(None), jobs.c.not_before <= now),
        or_(jobs.c.deadline.is_(None), jobs.c.deadline > now),
    )


def queued(not_before: datetime | None = None) -> Values:
    """To wait (again)."""
    return {
        "state": JobState.QUEUED,
        "not_before": not_before,
        "lease_until": None,
        "started_at": None,
        **progress(_QUEUED),
    }


def claimed(attempt: int, now: datetime, lease_s: float) -> Values:
    """To run for the `attempt`-th time."""
    return {
        "state": JobState.RUNNING,
        "attempt": attempt,
        "not_before": None,
        "lease_until": now + timedelta(seconds=lease_s),
        "started_at": now,
        **progress(_DECODE),
    }


def progress(made: Progress) -> Values:
    """How far a worker is."""
    return {"phase": made.phase, "phase_done": made.done, "phase_total": made.total}


def ended(state: JobState, row: JobRow, now: datetime, error: Values | None = None) -> Values:
    """To be in a final state, without a result."""
    return {
        "state": state,
        "finished_at": now,
        "lease_until": None,
        "not_before": None,
        "bytes_held": row.bytes_held if row.keep_inputs else 0,
        "bytes_reserved": 0,
        "error": error,
    }


def finished(outcome: Outcome, row: JobRow, now: datetime, ttl_s: float) -> Values:
    """To be as the outcome says."""
    told = {
        "backend": outcome.backend,
        "device": outcome.device,
        "timings_ms": dict(outcome.timings_ms),
        "meta": outcome.meta,
    }
    if outcome.error is None:
        return (
            ended(JobState.SUCCEEDED, row, now)
            | told
            | {
                "result_blob": outcome.result_blob,
                "result_sha256": outcome.result_sha256,
                "expires_at": now + timedelta(seconds=ttl_s),
            }
        )
    if outcome.error["slug"] == "job-cancelled":
        return ended(JobState.CANCELLED, row, now) | told
    return ended(JobState.FAILED, row, now, dict(outcome.error)) | told


def released(row: JobRow, now: datetime, delay_s: float) -> Values:
    """To wait again, at least for `delay_s` seconds, or to end if it was cancelled."""
    if row.cancel_requested:
        return ended(JobState.CANCELLED, row, now)
    return queued(now + timedelta(seconds=delay_s) if delay_s else None)


def crashed(row: JobRow, now: datetime, why: str) -> Values:
    """To wait again after its worker was lost, or to end if it was cancelled or is poison."""
    crashes = row.crashes + 1
    if row.cancel_requested:
        return ended(JobState.CANCELLED, row, now) | {"crashes": crashes}
    if crashes < MOST_CRASHES:
        return queued() | {"crashes": crashes}
    detail = f"{crashes} workers were lost while they worked on it; the last: {why}"
    return ended(JobState.FAILED, row, now, {"slug": "poison-job", "detail": detail}) | {"crashes": crashes}


def overdue(row: JobRow, now: datetime) -> Values:
    """To end, for nobody waits for it any more."""
    detail = f"it was still queued at its deadline, {row.deadline:%Y-%m-%d %H:%M:%S} UTC"
    return ended(JobState.FAILED, row, now, {"slug": "deadline-exceeded", "detail": detail})


def blobs_of(row: JobRow) -> list[str]:
    """Names of the blobs that a job has, or that its worker may be about to write."""
    names = [inputs_blob(row.id)] if not JobState(row.state).final or row.keep_inputs else []
    if row.state == JobState.RUNNING:
        names.append(result_blob(row.id, row.attempt))
    return names + ([row.result_blob] if row.result_blob else [])


def select_for_update(*conditions: ColumnElement[bool], others: bool = False) -> Any:
    """Select rows to change; `others`: leave out those that another transaction changes right now."""
    return select(jobs).where(*conditions).with_for_update(skip_locked=others)
