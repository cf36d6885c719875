"""The ledger: the truth about all jobs. What it has accepted is not lost, and no job ends twice.

Each method is one transaction. Any number of threads and, on PostgreSQL, of processes and hosts may call it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import ColumnElement, Connection, Engine, bindparam, delete, func, select, true, tuple_

from stereomend.errors import JobFinished, JobNotFound
from stereomend.jobs.killpoints import pass_killpoint
from stereomend.jobs.ledger import rows
from stereomend.jobs.ledger.admission import check_room, replayed
from stereomend.jobs.ledger.answers import Accepted, Page, Reaped, Renewal, Stats
from stereomend.jobs.ledger.cursors import after, cursor_of
from stereomend.jobs.ledger.database import Clock, Database
from stereomend.jobs.ledger.schema import jobs
from stereomend.jobs.records import (
    Claim,
    JobRecord,
    JobState,
    NewJob,
    Outcome,
    Progress,
    Room,
    inputs_blob,
    is_job_id,
)

OnEnded = Callable[[JobState], None]


class Ledger:
    """Jobs in a database.

    Every method may raise NotReady (the database is busy or out of reach; whether anything was changed is not
    known), and those that write DiskFull (nothing was changed).
    """

    def __init__(self, database: Database, on_ended: OnEnded | None = None) -> None:
        self._database = database
        self._on_ended = on_ended

    @classmethod
    def open(
        cls, url: str, clock: Clock | None = None, on_ended: OnEnded | None = None, migrate: bool = True
    ) -> Ledger:
        """Open `sqlite:////folder/file` (made where missing) or `postgresql://...`, and migrate it.

        `clock` replaces the time of this host, or of PostgreSQL's. `on_ended` hears of each job that this
        ledger brought to a final state, once that is on the disk, in whatever thread did it.

        Raises:
            OutdatedLedger: without `migrate`, the schema is older.
            ConfigurationError: the URL is of no use here, or what it names cannot be reached or written, is
                damaged, or was made by a newer version.
        """
        return cls(Database.open(url, clock, migrate), on_ended)

    @property
    def engine(self) -> Engine:
        """The engine, for the store of keys."""
        return self._database.engine

    def close(self) -> None:
        """Give back all connections."""
        self._database.engine.dispose()

    def accept(self, job: NewJob, room: Room, claimed_for_s: float | None = None) -> Accepted:
        """Take a job whose inputs are stored; when this returns, it is on the disk.

        With `claimed_for_s` it runs already, and is claimed for so many seconds.

        Raises:
            IdempotencyMismatch: the idempotency key belongs to a job with other files or parameters.
            QuotaExceeded, QueueFull, DiskFull: there is no room for it.
            NotReady: it may have been accepted, so its blob must stay; the sweeper knows.
        """
        with self._database.writing() as connection:
            self._database.admitting(connection)
            known = replayed(connection, job)
            if known:
                return Accepted(rows.record_of(known), replayed=True)
            check_room(connection, job, room)
            now = self._database.now(connection)
            row = rows.insert_job(connection, job, now)
            pass_killpoint("job-inserted")
            if claimed_for_s is None:
                return Accepted(rows.record_of(row))
            row = _changed(connection, row, rows.claimed(1, now, claimed_for_s))
            return Accepted(rows.record_of(row), claim=rows.claim_of(row))

    def get(self, id: str, owner: str | None) -> JobRecord:
        """Look up a job of an owner, None: of anybody (raises JobNotFound)."""
        with self._database.reading() as connection:
            return rows.record_of(_found(connection, select(jobs), id, owner))

    def page(
        self, owner: str | None, state: JobState | None = None, limit: int = 50, cursor: str | None = None
    ) -> Page:
        """List jobs, newest first (raises InvalidParameter: `cursor` is none of `next_cursor`)."""
        which = [_owned(owner), true() if state is None else jobs.c.state == state]
        if cursor is not None:
            which.append(tuple_(jobs.c.created_at, jobs.c.id) < tuple_(*after(cursor)))
        newest = select(jobs).where(*which).order_by(jobs.c.created_at.desc(), jobs.c.id.desc())
        with self._database.reading() as connection:
            found = connection.execute(newest.limit(limit + 1)).all()
        shown = found[:limit]
        return Page([rows.record_of(row) for row in shown], cursor_of(shown[-1]) if found[limit:] else None)

    def claim(self, lease_s: float) -> Claim | None:
        """Take the job that is to run next: of the highest priority the oldest; None: there is none."""
        with self._database.writing() as connection:
            now = self._database.now(connection)
            first = rows.select_for_update(rows.claimable(now), others=True)
            ordered = first.order_by(jobs.c.priority.desc(), jobs.c.created_at, jobs.c.id).limit(1)
            row = connection.execute(ordered).one_or_none()
            if row is None:
                return None
            return rows.claim_of(_changed(connection, row, rows.claimed(row.attempt + 1, now, lease_s)))

    def renew(self, claim: Claim, lease_s: float, progress: Progress) -> Renewal:
        """Hold a claim for `lease_s` seconds from now, and tell how far the work is."""
        with self._database.writing() as connection:
            row = _held(connection, claim)
            if row is None:
                return Renewal(held=False, cancel_requested=False)
            lease_until = self._database.now(connection) + timedelta(seconds=lease_s)
            moved = progress != (row.phase, row.phase_done, row.phase_total)
            values = {"lease_until": lease_until, "version": row.version + moved, **rows.progress(progress)}
            connection.execute(jobs.update().where(jobs.c.id == claim.id).values(values))
            return Renewal(held=True, cancel_requested=row.cancel_requested)

    def release(self, claim: Claim, delay_s: float = 0) -> bool:
        """Put a job back for others, through no fault of its own; False: the claim was lost.

        It is not claimed for `delay_s` seconds; one that was to be cancelled is cancelled.
        """
        with self._database.writing() as connection:
            row = _held(connection, claim)
            if row is None:
                return False
            now = self._database.now(connection)
            _changed(connection, row, rows.released(row, now, delay_s))
            return True

    def crash(self, claim: Claim, why: str) -> JobState | None:
        """Tell that the worker died: its job waits again, or fails as `poison-job`; None: lost claim."""
        with self._database.writing() as connection:
            row = _held(connection, claim)
            if row is None:
                return None
            now = self._database.now(connection)
            state = JobState(_changed(connection, row, rows.crashed(row, now, why)).state)
        self._tell(state)
        return state

    def finish(self, claim: Claim, outcome: Outcome, result_ttl_s: float) -> bool:
        """End a job; its result is kept for `result_ttl_s` seconds.

        False: the claim was lost, nothing was changed, and the caller deletes its blob.

        Raises:
            ValueError: the outcome has neither a result nor an error, or both.
        """
        if (outcome.error is None) == (outcome.result_blob is None):
            raise ValueError("an outcome has either a result or an error")
        with self._database.writing() as connection:
            row = _held(connection, claim)
            if row is None:
                return False
            values = rows.finished(outcome, row, self._database.now(connection), result_ttl_s)
            changed = rows.change(connection, rows.held(claim), values)
        if changed is not None:
            self._tell(changed.state)
        return changed is not None

    def cancel(self, id: str, owner: str | None) -> JobRecord:
        """Cancel what waits, ask the worker of what runs to stop, and leave what is cancelled.

        Raises:
            JobNotFound: no such job of this owner.
            JobFinished: it has ended otherwise.
        """
        with self._database.writing() as connection:
            row = _found(connection, rows.select_for_update(), id, owner)
            before = row.state
            if row.state == JobState.QUEUED:
                ended = rows.ended(JobState.CANCELLED, row, self._database.now(connection))
                row = _changed(connection, row, ended)
            elif row.state == JobState.RUNNING and not row.cancel_requested:
                row = _changed(connection, row, {"cancel_requested": True})
            elif row.state not in (JobState.RUNNING, JobState.CANCELLED):
                raise JobFinished(f"job {id} has {row.state} and cannot be cancelled")
        if row.state != before:
            self._tell(row.state)
        return rows.record_of(row)

    def reap(self) -> Reaped:
        """Take jobs from workers whose leases are over, and fail those that waited past their deadline."""
        reaped = Reaped([], [], [])
        with self._database.writing() as connection:
            now = self._database.now(connection)
            silent = rows.select_for_update(
                jobs.c.state == JobState.RUNNING, jobs.c.lease_until < now, others=True
            )
            for row in connection.execute(silent).all():
                _sort(reaped, _changed(connection, row, rows.crashed(row, now, "lease expired")))
            late = rows.select_for_update(
                jobs.c.state == JobState.QUEUED, jobs.c.deadline <= now, others=True
            )
            for row in connection.execute(late).all():
                _sort(reaped, _changed(connection, row, rows.overdue(row, now)))
        self._tell(*[JobState.FAILED] * len(reaped.ended))
        return reaped

    def recover(self) -> int:
        """Take all running jobs from their workers, which ended with the only server; returns how many.

        They are not to blame: the server touches no pixel, and may be killed any number of times.
        Only where no other process runs jobs of this ledger.
        """
        with self._database.writing() as connection:
            now = self._database.now(connection)
            running = connection.execute(rows.select_for_update(jobs.c.state == JobState.RUNNING)).all()
            changed = [_changed(connection, row, rows.released(row, now, 0)) for row in running]
        self._tell(*(row.state for row in changed))
        return len(changed)

    def expired(self, record_ttl_s: float) -> list[str]:
        """Let go of results past their time, and of records that ended `record_ttl_s` seconds ago.

        Returns the names of the blobs to delete; what is not deleted is an orphan, which the sweeper finds.
        """
        with self._database.writing() as connection:
            now = self._database.now(connection)
            names = _expire_results(connection, now)
            gone = _delete_records(connection, now - timedelta(seconds=record_ttl_s))
        self._tell(*[JobState.EXPIRED] * len(names))
        return names + gone

    def purge(self, id: str, owner: str | None) -> list[str]:
        """Remove a job, whatever its state; returns the names of its blobs (raises JobNotFound)."""
        with self._database.writing() as connection:
            row = _found(connection, rows.select_for_update(), id, owner)
            connection.execute(delete(jobs).where(jobs.c.id == id))
        return rows.blobs_of(row)

    def known_blobs(self) -> set[str]:
        """Names of all blobs that jobs have, or that their workers may be about to write."""
        columns = (jobs.c.id, jobs.c.state, jobs.c.attempt, jobs.c.keep_inputs, jobs.c.result_blob)
        with self._database.reading() as connection:
            return {name for row in connection.execute(select(*columns)) for name in rows.blobs_of(row)}

    def stats(self) -> Stats:
        """Count jobs and bytes."""
        by_state = select(
            jobs.c.state,
            func.count(),
            func.sum(jobs.c.bytes_held),
            func.sum(jobs.c.bytes_reserved),
            func.min(jobs.c.created_at),
        ).group_by(jobs.c.state)
        with self._database.reading() as connection:
            now = self._database.now(connection)
            found = {row[0]: row[1:] for row in connection.execute(by_state)}
        counts = {state: found[state][0] if state in found else 0 for state in JobState}
        held, reserved = (sum(int(row[column]) for row in found.values()) for column in (1, 2))
        waiting = found.get(JobState.QUEUED)
        return Stats(counts, max(0.0, (now - waiting[3]).total_seconds()) if waiting else 0.0, held, reserved)

    def check(self) -> Mapping[str, str]:
        """What the database says of how safe it is, by the names of its own settings."""
        return self._database.facts()

    def _tell(self, *states: str) -> None:
        for state in map(JobState, states):
            if self._on_ended and state.final:
                self._on_ended(state)


def _owned(owner: str | None) -> ColumnElement[bool]:
    return true() if owner is None else jobs.c.owner == owner


def _found(connection: Connection, selected: Any, id: str, owner: str | None) -> rows.JobRow:
    row = None
    if is_job_id(id):
        row = connection.execute(selected.where(jobs.c.id == id, _owned(owner))).one_or_none()
    if row is None:
        raise JobNotFound(f"there is no job {id!r}, or it belongs to another key")
    return row


def _held(connection: Connection, claim: Claim) -> rows.JobRow | None:
    return connection.execute(rows.select_for_update(rows.held(claim))).one_or_none()


def _changed(connection: Connection, row: rows.JobRow, values: rows.Values) -> rows.JobRow:
    changed = rows.change(connection, jobs.c.id == row.id, values)
    assert changed is not None, "the row is locked"
    return changed


def _sort(reaped: Reaped, row: rows.JobRow) -> None:
    if row.state == JobState.QUEUED:
        reaped.queued.append(row.id)
        return
    reaped.ended.append(row.id)
    if not row.keep_inputs:
        reaped.blobs.append(inputs_blob(row.id))


def _expire_results(connection: Connection, now: datetime) -> list[str]:
    due = rows.select_for_update(jobs.c.state == JobState.SUCCEEDED, jobs.c.expires_at <= now, others=True)
    found = connection.execute(due).all()
    for row in found:
        _changed(connection, row, {"state": JobState.EXPIRED, "result_blob": None})
    return [row.result_blob for row in found]


def _delete_records(connection: Connection, before: datetime) -> list[str]:
    found = connection.execute(rows.select_for_update(jobs.c.finished_at <= before, others=True)).all()
    if found:
        each = delete(jobs).where(jobs.c.id == bindparam("gone"))
        connection.execute(each, [{"gone": row.id} for row in found])
    return [name for row in found for name in rows.blobs_of(row)]
