"""Which jobs are accepted: replays, and room."""

from __future__ import annotations

from sqlalchemy import Connection, func, select

from stereomend.errors import DiskFull, IdempotencyMismatch, QueueFull, QuotaExceeded
from stereomend.jobs.ledger.rows import LIVE, JobRow
from stereomend.jobs.ledger.schema import jobs
from stereomend.jobs.records import NewJob, Room

_MIB = 1 << 20


def replayed(connection: Connection, job: NewJob) -> JobRow | None:
    """Find the job that was accepted under the same key (raises IdempotencyMismatch: it was another)."""
    if job.idempotency_key is None:
        return None
    same = select(jobs).where(jobs.c.owner == job.owner, jobs.c.idempotency_key == job.idempotency_key)
    row = connection.execute(same).one_or_none()
    if row and (row.input["sha256"], row.params) != (job.input["sha256"], dict(job.params)):
        raise IdempotencyMismatch(
            f"the idempotency key belongs to job {row.id}, which has other files or parameters"
        )
    return row


def check_room(connection: Connection, job: NewJob, room: Room) -> None:
    """Compare what waits and runs with what may (raises QuotaExceeded, QueueFull, DiskFull)."""
    live = connection.execute(
        select(
            func.count().label("jobs"),
            func.count().filter(jobs.c.owner == job.owner).label("own"),
            func.coalesce(func.sum(jobs.c.bytes_held), 0).label("held"),
            func.coalesce(func.sum(jobs.c.bytes_reserved), 0).label("reserved"),
        ).where(LIVE)
    ).one()
    if live.own >= room.most_jobs_of_owner:
        raise QuotaExceeded(f"{live.own} jobs of this key wait or run; it may have {room.most_jobs_of_owner}")
    # A job larger than all that may wait runs alone, or it would be told forever to come again.
    if live.jobs >= room.most_jobs or (live.jobs and live.held + job.bytes_held > room.most_bytes):
        raise QueueFull(
            f"{live.jobs} jobs with {live.held // _MIB} MiB wait or run; "
            f"the server holds {room.most_jobs} with {room.most_bytes // _MIB} MiB"
        )
    free = room.free_disk_bytes - int(live.reserved)
    if job.bytes_reserved > free:
        raise DiskFull(
            f"the result may need {job.bytes_reserved / _MIB:.1f} MiB of the disk, "
            f"where {max(free, 0) / _MIB:.1f} are left"
        )
