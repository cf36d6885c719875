"""Runs the jobs of the ledger: claims them when the pool has a turn for them, and brings each to an end."""

from __future__ import annotations

import asyncio
import hashlib
import logging
from collections.abc import Callable
from time import monotonic
from typing import Protocol, TypeVar

from stereomend.codec import STORED_TYPE
from stereomend.errors import (
    DiskFull,
    InternalError,
    NotReady,
    StereomendError,
    Unavailable,
    WorkerCrashed,
)
from stereomend.jobs.blobs import unpack
from stereomend.jobs.changes import Changes, rung
from stereomend.jobs.killpoints import pass_killpoint
from stereomend.jobs.pool import WorkerPool
from stereomend.jobs.records import Claim, Outcome, Progress, inputs_blob, result_blob
from stereomend.jobs.store import Store
from stereomend.jobs.task import Answer, Files, Task
from stereomend.jobs.turns import Ticket
from stereomend.refinement import RefineParams
from stereomend.settings import Settings

log = logging.getLogger(__name__)

T = TypeVar("T")

POLL_S = 0.5
"""Jobs that were released for later are looked for so often."""
RENEW_S = 1.0
"""How often progress is written to the ledger, and cancelling is looked for, while a job runs."""
DISK_FULL_PAUSE_S = 5.0
"""For so long a job waits whose result did not fit the disk."""
_RETRY_S = 0.5
_LAST_RETRIES = 4


class Runner:
    """Between the ledger and the pool; belongs to the event loop."""

    def __init__(self, store: Store, pool: WorkerPool, settings: Settings, changes: Changes) -> None:
        self._store = store
        self._pool = pool
        self._settings = settings
        self._changes = changes
        self._bell = asyncio.Event()
        self._running: dict[str, Ticket] = {}
        self._attending: set[asyncio.Task[None]] = set()
        self._dispatching: asyncio.Task[None] | None = None
        self._claiming: asyncio.Task[bool] | None = None
        self._stopping = False

    def start(self) -> None:
        """Begin to claim jobs."""
        self._dispatching = asyncio.create_task(self._dispatch())

    async def close(self) -> None:
        """Claim no more; what was claimed last has been handed to the pool when this returns."""
        self._stopping = True
        if self._dispatching:
            self._dispatching.cancel()
            await asyncio.wait([self._dispatching])
        if self._claiming:
            await asyncio.wait([self._claiming])

    async def stop(self) -> None:
        """Wait until all that run have ended, which the pool that stops sees to; follows `close`."""
        if self._attending:
            await asyncio.wait(self._attending)

    def ring(self) -> None:
        """Tell that the ledger has a job to run."""
        self._bell.set()

    def call_off(self, id: str) -> None:
        """End the work on a job, if it runs."""
        if ticket := self._running.get(id):
            self._pool.call_off(ticket)

    def adopt(self, claim: Claim, ticket: Ticket) -> None:
        """Bring a claim whose work is on its way already to its end."""
        self._running[claim.id] = ticket
        attending = asyncio.create_task(self._attend(claim, ticket))
        self._attending.add(attending)
        attending.add_done_callback(self._attending.discard)

    async def _dispatch(self) -> None:
        while True:
            try:
                await self._pool.welcomes_job.wait()
                self._bell.clear()
                if not await self._begin_one():
                    await rung(self._bell, POLL_S)
            except Exception:
                log.exception("no job can be taken from the ledger")
                await asyncio.sleep(_RETRY_S)

    async def _begin_one(self) -> bool:
        # Shielded, or a claim made while this is cancelled would be nobody's.
        self._claiming = asyncio.create_task(self._claim())
        return await asyncio.shield(self._claiming)

    async def _claim(self) -> bool:
        claim = await self._store.ask(self._store.ledger.claim, self._settings.lease_s)
        if claim is None:
            return False
        self._changes.ring(claim.id)
        try:
            task = await self._store.move(self._task, claim)
        except StereomendError as error:
            await self._end(claim, _failure(error))
        except Exception:
            log.exception("job %s cannot be begun", claim.id)
            await self._end(claim, _failure(InternalError("what was stored of this job cannot be read")))
        else:
            self.adopt(claim, self._pool.enqueue_job(task))
        return True

    def _task(self, claim: Claim) -> Task:
        files = unpack(self._store.blobs.get(inputs_blob(claim.id)))
        return task_of(files, RefineParams.model_validate(claim.params), claim)

    async def _attend(self, claim: Claim, ticket: Ticket) -> None:
        renewing = asyncio.create_task(self._renew(claim, ticket))
        try:
            await asyncio.wait([ticket.answer])
            await self._conclude(claim, ticket)
        except Exception:
            log.exception("job %s could not be brought to its end", claim.id)
        finally:
            renewing.cancel()
            if self._running.get(claim.id) is ticket:
                del self._running[claim.id]
            self._changes.ring(claim.id)
            self.ring()

    async def _renew(self, claim: Claim, ticket: Ticket) -> None:
        """Hold the lease while the pool answers for the work: it kills workers that are silent."""
        told, renewed_at = Progress("decode"), monotonic()
        while True:
            await asyncio.sleep(min(RENEW_S, self._settings.lease_s / 4))
            if ticket.progress == told and monotonic() - renewed_at < self._settings.lease_s / 4:
                continue
            told, renewed_at = ticket.progress, monotonic()
            try:
                renewal = await self._store.ask(self._store.ledger.renew, claim, self._settings.lease_s, told)
            except Unavailable as error:
                log.warning("the lease of job %s is not renewed: %s", claim.id, error)
                continue
            self._changes.ring(claim.id)
            if renewal.cancel_requested or not renewal.held:
                self._pool.call_off(ticket)

    async def _conclude(self, claim: Claim, ticket: Ticket) -> None:
        error = ticket.answer.exception()
        if error is None:
            await self._keep(claim, ticket.answer.result())
        elif isinstance(error, NotReady) or (isinstance(error, WorkerCrashed) and self._stopping):
            await self._release(claim, 0)
        elif isinstance(error, WorkerCrashed):
            log.warning("job %s lost its worker in attempt %d: %s", claim.id, claim.attempt, error)
            await self._insist(lambda: self._store.ledger.crash(claim, str(error)))
        elif isinstance(error, StereomendError):
            await self._end(claim, _failure(error))
        else:
            raise error

    async def _keep(self, claim: Claim, answer: Answer) -> None:
        blob = result_blob(claim.id, claim.attempt)
        try:
            digest = await self._store.move(self._put, blob, answer.body)
        except (DiskFull, OSError) as error:
            log.error("the result of job %s cannot be stored, so it runs again: %s", claim.id, error)
            await self._release(claim, DISK_FULL_PAUSE_S)
        else:
            pass_killpoint("result-stored")
            await self._end(claim, _success(answer, blob, digest))

    def _put(self, blob: str, body: bytes) -> str:
        self._store.blobs.put(blob, [body])
        return hashlib.sha256(body).hexdigest()

    async def _end(self, claim: Claim, outcome: Outcome) -> None:
        ledger, ttl_s = self._store.ledger, self._settings.result_ttl_s
        ended, sure = await self._insist(lambda: ledger.finish(claim, outcome, ttl_s))
        if ended and not claim.keep_inputs:
            await self._store.move(self._store.blobs.delete, inputs_blob(claim.id))
        # Where an earlier try may have told the ledger already, what is left is the sweeper's.
        if not ended and sure and outcome.result_blob:
            await self._store.move(self._store.blobs.delete, outcome.result_blob)

    async def _release(self, claim: Claim, delay_s: float) -> None:
        await self._insist(lambda: self._store.ledger.release(claim, delay_s))

    async def _insist(self, call: Callable[[], T]) -> tuple[T, bool]:
        """Tell the ledger something until it takes it; also returns whether it was told only once.

        The work is not lost meanwhile: the blob is stored, and the claim is held or taken back by the reaper.
        """
        tries = 0
        while True:
            try:
                return await self._store.ask(call), tries == 0
            except Unavailable as error:
                tries += 1
                if self._stopping and tries > _LAST_RETRIES:
                    raise
                log.warning("the ledger takes nothing: %s", error)
            await asyncio.sleep(_RETRY_S)


class Origin(Protocol):
    """What a task is to be known by: a claim or a submission."""

    @property
    def request_id(self) -> str:
        """For log lines."""

    @property
    def traceparent(self) -> str | None:
        """As `Task.traceparent`."""


def task_of(files: Files, params: RefineParams, origin: Origin) -> Task:
    """The task of a job: its answer is stored and holds everything."""
    return Task(
        files.left,
        files.right,
        files.disparity,
        mask=files.mask,
        params=params,
        media_type=STORED_TYPE,
        request_id=origin.request_id,
        traceparent=origin.traceparent,
    )


def _success(answer: Answer, blob: str, digest: str) -> Outcome:
    return Outcome(
        backend=answer.meta.get("backend"),
        device=answer.meta.get("device"),
        timings_ms=answer.timings,
        meta=answer.meta,
        result_blob=blob,
        result_sha256=digest,
    )


def _failure(error: StereomendError) -> Outcome:
    return Outcome(error={"slug": error.slug, "detail": str(error)})
