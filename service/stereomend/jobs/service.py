"""Jobs as the routes see them, and all that keeps them going."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from dataclasses import replace
from time import monotonic
from typing import Any, NamedTuple, TypeVar

from stereomend.codec import render
from stereomend.errors import (
    DiskFull,
    InputError,
    JobCancelled,
    JobFailed,
    JobNotFinished,
    NotReady,
    QueueFull,
    QuotaExceeded,
    ResultExpired,
    StereomendError,
    Unavailable,
)
from stereomend.jobs.changes import Changes, rung
from stereomend.jobs.killpoints import pass_killpoint
from stereomend.jobs.ledger import Accepted, Page, Stats
from stereomend.jobs.listener import Listener
from stereomend.jobs.memory import give_back_freed_memory
from stereomend.jobs.pool import GRACE_S, WorkerPool
from stereomend.jobs.records import JobRecord, JobState, NewJob, inputs_blob
from stereomend.jobs.runner import Runner, task_of
from stereomend.jobs.store import Store
from stereomend.jobs.submission import Alone, Submission, new_job
from stereomend.jobs.sweeper import Sweeper
from stereomend.jobs.task import Answer
from stereomend.jobs.turns import Ticket
from stereomend.settings import Settings

__all__ = ["JobService", "StoredResult", "Submission"]

log = logging.getLogger(__name__)

T = TypeVar("T")

_REAP_S = 2.0
_SWEEP_S = 60.0
_TRIM_S = 10.0


class StoredResult(NamedTuple):
    """A result as it is stored; `codec.render` writes it in a media type, which takes a thread."""

    record: JobRecord
    content: bytes


class JobService:
    """All about jobs, from `start` to `stop` on one event loop.

    Whoever asks with an owner is told of no other's jobs; None sees all.
    """

    def __init__(self, settings: Settings, pool: WorkerPool, listeners: Sequence[Listener] = ()) -> None:
        self._settings = settings
        self._listeners = listeners
        self._pool = pool
        self._changes = Changes()
        self._in_flight: set[tuple[str, str]] = set()
        self._accepting: set[asyncio.Task[Any]] = set()
        self._chores: list[asyncio.Task[None]] = []
        self._opened: tuple[Store, Runner] | None = None
        self._stopping = False

    async def start(self) -> None:
        """Open the data folder, take back what ran when the last server ended, and run what waits.

        Raises:
            ConfigurationError: the data folder cannot be used.
        """
        store = await asyncio.to_thread(Store, self._settings, self._job_ended)
        runner = Runner(store, self._pool, self._settings, self._changes)
        self._opened = store, runner
        if found := await store.ask(store.ledger.recover):
            log.warning("%d jobs ran when the last server ended and are taken up again", found)
        sweeper = Sweeper(store.ledger, store.blobs, self._settings.record_ttl_s)
        runner.start()
        self._chores = [
            asyncio.create_task(_every(min(_REAP_S, self._settings.lease_s / 2), self._reap)),
            asyncio.create_task(_every(self._sweep_s, lambda: store.move(sweeper.sweep))),
            asyncio.create_task(_every(_TRIM_S, lambda: asyncio.to_thread(give_back_freed_memory))),
        ]

    async def stop(self, grace_s: float = GRACE_S) -> None:
        """Accept nothing more, let what runs finish for `grace_s` seconds, and leave the rest queued.

        Stops the pool too, which ends its workers.
        """
        self._stopping = True
        self._changes.ring_all()
        for chore in self._chores:
            chore.cancel()
        if self._accepting:
            await asyncio.wait(self._accepting, timeout=grace_s)
        if self._opened:
            await self._runner.close()
        await asyncio.gather(self._pool.stop(grace_s), *([self._runner.stop()] if self._opened else []))
        if self._opened:
            store, self._opened = self._store, None
            await asyncio.to_thread(store.close)

    async def submit(self, submission: Submission) -> Accepted:
        """Accept a job: when this returns it is on the disk, and will be run whatever dies.

        Raises:
            UnknownFormat, DamagedFile, TooManyPixels: of the left image, by its header.
            IdempotencyInFlight: a submission with this key is being taken in.
            IdempotencyMismatch: the key was used with other files or parameters.
            QuotaExceeded, QueueFull, DiskFull: there is no room; `retry_after` says when to come again.
            NotReady: the server is ending.
        """
        with self._alone(submission):
            return await self._safely(self._submit(submission))

    async def refine(
        self, submission: Submission, media_type: str, wait_s: float | None = None
    ) -> Answer | Accepted:
        """Refine now, in memory, for somebody who waits.

        With `wait_s` it becomes a job that outlasts the caller after so many seconds, whether it runs or not:
        then it is accepted as by `submit`, priority, deadline and all.

        Raises:
            IdempotencyInFlight: a request with this key is being answered.
            QueueFull, NotReady, WorkerCrashed, WorkLimitExceeded, InputError: as `WorkerPool.submit`.
            All that `submit` raises: when it becomes a job.
        """
        task = task_of(submission.files, submission.params, submission)
        if wait_s is None:
            with self._alone(submission):
                return await self._pool.submit(replace(task, media_type=media_type))
        if wait_s <= 0:
            return await self.submit(submission)
        with self._alone(submission):
            ticket = self._pool.enqueue(task)
            try:
                await asyncio.wait([ticket.answer], timeout=wait_s)
                if not ticket.answer.done():
                    accepted = await self._safely(self._convert(ticket, submission))
                    if accepted is not None:
                        return accepted
                return await self._rendered(await asyncio.shield(ticket.answer), submission, media_type)
            except BaseException:
                if ticket.request:
                    self._pool.call_off(ticket)
                raise

    async def get(self, id: str, owner: str | None) -> JobRecord:
        """Look up a job (raises JobNotFound)."""
        return await self._store.ask(self._store.ledger.get, id, owner)

    async def page(
        self,
        owner: str | None,
        state: JobState | None = None,
        limit: int = 50,
        cursor: str | None = None,
    ) -> Page:
        """List jobs, newest first (raises InvalidParameter for a bad cursor)."""
        return await self._store.ask(self._store.ledger.page, owner, state, limit, cursor)

    async def changed(self, id: str, owner: str | None, version: int, timeout_s: float) -> JobRecord:
        """Wait until a job has another version, or the time is over, or the server ends.

        Raises:
            JobNotFound: it is not there, or not any more.
        """
        loop = asyncio.get_running_loop()
        deadline = loop.time() + timeout_s
        with self._changes.watching(id) as changed:
            while True:
                changed.clear()
                record = await self.get(id, owner)
                left = deadline - loop.time()
                if record.version != version or left <= 0 or self._stopping:
                    return record
                await rung(changed, left)

    async def cancel(self, id: str, owner: str | None) -> JobRecord:
        """Cancel what waits at once, and what runs between two steps of the work.

        Raises:
            JobNotFound: no such job.
            JobFinished: it has ended otherwise.
        """
        record = await self._store.ask(self._store.ledger.cancel, id, owner)
        self._runner.call_off(id)
        if record.state is JobState.CANCELLED and not record.keep_inputs:
            await self._store.move(self._store.blobs.delete, inputs_blob(id))
        self._changes.ring(id)
        return record

    async def purge(self, id: str, owner: str | None) -> None:
        """Remove a job and all its files at once, whatever its state (raises JobNotFound)."""
        blobs = await self._store.ask(self._store.ledger.purge, id, owner)
        self._runner.call_off(id)
        for blob in blobs:
            await self._store.move(self._store.blobs.delete, blob)
        self._changes.ring(id)

    async def result(self, id: str, owner: str | None) -> StoredResult:
        """Fetch a result.

        Raises:
            JobNotFound: no such job.
            JobNotFinished, JobFailed, JobCancelled, ResultExpired: there is none.
        """
        record = await self.get(id, owner)
        if record.state is not JobState.SUCCEEDED or record.result_blob is None:
            raise _no_result(record)
        content = await self._store.move(self._store.blobs.result, record.result_blob)
        return StoredResult(record, content)

    @property
    def ending(self) -> bool:
        """Whether the server is to end: nothing is accepted, and changes are not waited for."""
        return self._stopping

    async def stats(self) -> Stats:
        """Count the jobs of the ledger by state, and their bytes."""
        return await self._store.ask(self._store.ledger.stats)

    @property
    def store(self) -> Store:
        """The open data folder, for the store of keys and for the doctor (raises NotReady)."""
        return self._store

    @property
    def _store(self) -> Store:
        if self._opened is None:
            raise self._closed()
        return self._opened[0]

    @property
    def _sweep_s(self) -> float:
        # Results that are kept shortly are asked for soon after their time.
        return min(_SWEEP_S, max(1.0, self._settings.result_ttl_s / 4))

    @property
    def _runner(self) -> Runner:
        if self._opened is None:
            raise self._closed()
        return self._opened[1]

    def _closed(self) -> NotReady:
        error = NotReady(f"jobs are not served: the server is {'ending' if self._stopping else 'starting'}")
        error.retry_after = 1
        return error

    def _alone(self, submission: Submission) -> Alone:
        return Alone(self._in_flight, submission)

    async def _safely(self, work: Coroutine[Any, Any, T]) -> T:
        """Go on with what was begun even if the caller leaves: half of it would be of no use."""
        task = asyncio.create_task(work)
        self._accepting.add(task)
        task.add_done_callback(self._accepting.discard)
        return await asyncio.shield(task)

    async def _submit(self, submission: Submission) -> Accepted:
        if self._stopping:
            raise self._closed()
        job = await self._stored(submission)
        accepted = await self._accept(job)
        pass_killpoint("job-accepted")
        self._runner.ring()
        return accepted

    async def _convert(self, ticket: Ticket, submission: Submission) -> Accepted | None:
        """Make a job of a request that waits or runs; None: it has its answer, or there is no room for it."""
        try:
            job = await self._stored(submission)
        except Unavailable:
            return None
        if not ticket.answer.done() and self._pool.withdraw(ticket):
            accepted = await self._accept(job)
            self._runner.ring()
            return accepted
        return await self._accept_running(job, ticket)

    async def _accept_running(self, job: NewJob, ticket: Ticket) -> Accepted | None:
        if ticket.answer.done():
            await self._forget(job)
            return None
        try:
            accepted = await self._accept(job, self._settings.lease_s)
        except Unavailable:
            return None  # It is waited for after all.
        ticket.request = False
        if accepted.claim:
            self._runner.adopt(accepted.claim, ticket)
        else:
            self._pool.call_off(ticket)
        return accepted

    async def _stored(self, submission: Submission) -> NewJob:
        job, chunks = await self._store.move(new_job, submission, self._settings.max_pixels)
        await self._store.move(self._store.room, job.bytes_held + job.bytes_reserved)
        await self._store.move(self._store.blobs.put, inputs_blob(job.id), chunks)
        return job

    async def _accept(self, job: NewJob, claimed_for_s: float | None = None) -> Accepted:
        try:
            room = await self._store.move(self._store.room)
            accepted = await self._store.ask(self._store.ledger.accept, job, room, claimed_for_s)
        except (InputError, QueueFull, DiskFull) as error:
            await self._forget(job)
            if error.retry_after is None and isinstance(error, Unavailable):
                error.retry_after = self._half_done_s(isinstance(error, QuotaExceeded))
            raise
        if accepted.replayed:
            await self._forget(job)
        return accepted

    def _half_done_s(self, of_one_key: bool) -> int:
        """When half of what fills the queue, or a key's part of it, will be done at the pace so far."""
        settings = self._settings
        held = settings.max_jobs_per_key if of_one_key else settings.max_queued_jobs
        return math.ceil(self._pool.pace_s * held / settings.workers / 2)

    async def _forget(self, job: NewJob) -> None:
        await self._store.move(self._store.blobs.delete, inputs_blob(job.id))

    async def _rendered(self, answer: Answer, submission: Submission, media_type: str) -> Answer:
        outputs = submission.params.outputs
        body = await asyncio.to_thread(render, answer.body, media_type, outputs)
        return replace(answer, body=body, media_type=media_type)

    def _job_ended(self, state: JobState) -> None:
        for listener in self._listeners:
            listener.job_ended(state)

    async def _reap(self) -> None:
        reaped = await self._store.ask(self._store.ledger.reap)
        for id in (*reaped.queued, *reaped.ended):
            self._runner.call_off(id)
            self._changes.ring(id)
        for blob in reaped.blobs:
            await self._store.move(self._store.blobs.delete, blob)
        if reaped.queued:
            self._runner.ring()


def _no_result(record: JobRecord) -> StereomendError:
    id = record.id
    if not record.state.final:
        error = JobNotFinished(f"job {id} is {record.state}; it has no result yet")
        error.retry_after = 1
        return error
    if record.state is JobState.FAILED:
        told = record.error or {"slug": "error", "detail": "no reason is known"}
        return JobFailed(f"job {id} failed, {told['slug']}: {told['detail']}")
    if record.state is JobState.CANCELLED:
        return JobCancelled(f"job {id} was cancelled before it had a result")
    return ResultExpired(f"the result of job {id} was deleted after its time")


async def _every(seconds: float, chore: Callable[[], Awaitable[object]]) -> None:
    while True:
        began = monotonic()
        await asyncio.sleep(seconds)
        if monotonic() - began > 2 * seconds:
            continue  # This process stood still: first leases are renewed, of work that went on.
        try:
            await chore()
        except Unavailable as error:
            log.warning("the data folder is not looked after: %s", error)
        except Exception:
            log.exception("a chore of the server failed")
