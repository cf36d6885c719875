"""Any order of calls: the ledger does what a model in plain Python does."""

from collections import Counter
from datetime import timedelta

import pytest
import sqlalchemy as sa
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    Bundle,
    RuleBasedStateMachine,
    invariant,
    multiple,
    precondition,
    rule,
    run_state_machine_as_test,
)

from stereomend.errors import JobFinished, JobNotFound, StereomendError
from stereomend.jobs.ledger.schema import jobs as table
from stereomend.jobs.records import JobState, NewJob, Outcome, Progress, Room

from .model import FREE, LIVE, MOST_BYTES, MOST_JOBS, MOST_OF_OWNER, Job, Model

ROOM = Room(MOST_JOBS, MOST_BYTES, MOST_OF_OWNER, FREE)
OWNERS = st.sampled_from(["ann", "bob"])
SECONDS = st.sampled_from([0, 1, 7, 30, 31])


class LedgerMachine(RuleBasedStateMachine):
    """Calls both; `claims` holds all that were ever given, most of them lost."""

    ids = Bundle("ids")
    claims = Bundle("claims")

    def __init__(self, ledger, clock):
        super().__init__()
        self.ledger, self.clock, self.start = ledger, clock, clock.now
        self.model = Model()
        self.count = 0
        self.finished = Counter()
        self.seen = {}
        with ledger.engine.begin() as connection:
            connection.execute(sa.delete(table))

    def at(self, seconds):
        return None if seconds is None else self.start + timedelta(seconds=seconds)

    @rule(
        target=ids,
        owner=OWNERS,
        body=st.sampled_from("xy"),
        key=st.sampled_from([None, None, "k", "l"]),
        priority=st.integers(-1, 1),
        keep=st.booleans(),
        size=st.tuples(st.integers(0, 70), st.integers(0, 60)),
        deadline=st.none() | st.integers(0, 60),
        lease=st.none() | st.integers(1, 30),
    )
    def accept(self, owner, body, key, priority, keep, size, deadline, lease):
        self.count += 1
        due = None if deadline is None else self.model.now + deadline
        # Not in order, so that equal times are told apart by something else.
        id = f"{self.count * 7919 % 10007:032x}"
        job = Job(id, owner, body, key, priority, keep, *size, self.model.now, due)
        expected = self.model.refusal(job)
        if isinstance(expected, str):
            with pytest.raises(StereomendError) as refused:
                self.ledger.accept(self.new(job), ROOM, lease)
            assert refused.value.slug == expected
            return multiple()
        accepted = self.ledger.accept(self.new(job), ROOM, lease)
        if isinstance(expected, Job):
            assert (accepted.replayed, accepted.record.id, accepted.claim) == (True, expected.id, None)
            return expected.id
        assert expected is None
        assert not accepted.replayed
        self.model.jobs[id] = job
        if lease is not None:
            job.start(self.model.now, lease)
        return id

    def new(self, job):
        return NewJob(
            id=job.id,
            owner=job.owner,
            preset="paper",
            params={},
            input={"sha256": job.body},
            bytes_held=job.held,
            bytes_reserved=job.reserved,
            priority=job.priority,
            deadline=self.at(job.deadline),
            keep_inputs=job.keep,
            idempotency_key=job.key,
        )

    @rule(target=claims, lease=st.integers(1, 30))
    def claim(self, lease):
        expected = self.model.next()
        claim = self.ledger.claim(lease)
        assert (claim and claim.id) == (expected and expected.id)
        if claim is None:
            return multiple()
        expected.start(self.model.now, lease)
        assert claim.attempt == expected.attempt
        return claim

    @rule(claim=claims, lease=st.integers(1, 30), done=st.integers(0, 2))
    def renew(self, claim, lease, done):
        job = self.model.holder(claim)
        renewal = self.ledger.renew(claim, lease, Progress("gdr", done, 2))
        assert renewal == (job is not None, job is not None and job.cancel)
        if job:
            job.lease, job.progress = self.model.now + lease, ("gdr", done, 2)

    @rule(claim=claims, slug=st.sampled_from([None, None, "damaged-file", "job-cancelled"]), ttl=SECONDS)
    def finish(self, claim, slug, ttl):
        job = self.model.holder(claim)
        blob = f"results/{claim.id}.{claim.attempt}"
        told = Outcome(result_blob=blob) if slug is None else Outcome(error={"slug": slug, "detail": "d"})
        assert self.ledger.finish(claim, told, ttl) == (job is not None)
        if job is None:
            return
        self.finished[claim.id] += 1
        if slug is None:
            job.end("succeeded", self.model.now)
            job.result, job.expires = blob, self.model.now + ttl
        elif slug == "job-cancelled":
            job.end("cancelled", self.model.now)
        else:
            job.end("failed", self.model.now, slug)

    @rule(claim=claims)
    def crash(self, claim):
        job = self.model.holder(claim)
        state = self.ledger.crash(claim, "it died")
        if job:
            job.crash(self.model.now)
        assert state == (job and job.state)

    @rule(target=claims, claim=claims)
    def hand_over(self, claim):
        """Its worker is lost and another starts at once, which chance alone seldom does."""
        self.crash(claim)
        return self.claim(30)

    @rule(claim=claims, delay=SECONDS)
    def release(self, claim, delay):
        job = self.model.holder(claim)
        assert self.ledger.release(claim, delay) == (job is not None)
        if job and job.cancel:
            job.end("cancelled", self.model.now)
        elif job:
            job.wait(self.model.now + delay)

    @rule(id=ids, owner=OWNERS | st.none())
    def cancel(self, id, owner):
        job = self.model.jobs.get(id)
        try:
            record = self.ledger.cancel(id, owner)
        except JobNotFound:
            assert job is None or owner not in (None, job.owner)
            return
        except JobFinished:
            assert job.state in ("succeeded", "failed", "expired")
            return
        assert owner in (None, job.owner)
        if job.state == "queued":
            job.end("cancelled", self.model.now)
        elif job.state == "running":
            job.cancel = True
        assert record.state == job.state in ("running", "cancelled")

    @rule(id=ids, owner=OWNERS | st.none())
    def purge(self, id, owner):
        job = self.model.jobs.get(id)
        try:
            names = self.ledger.purge(id, owner)
        except JobNotFound:
            assert job is None or owner not in (None, job.owner)
            return
        assert set(names) == self.model.jobs.pop(id).blobs()

    @rule(seconds=SECONDS)
    def let_time_pass(self, seconds):
        self.clock.move(seconds)
        self.model.now += seconds

    @rule()
    def reap(self):
        queued, ended = self.model.reap()
        reaped = self.ledger.reap()
        assert set(reaped.ended) == ended
        assert set(reaped.queued) - ended == queued
        kept = {id for id in ended if self.model.jobs[id].keep}
        assert set(reaped.blobs) == {f"inputs/{id}" for id in ended - kept}

    @precondition(lambda self: any(job.state == "running" for job in self.model.jobs.values()))
    @rule()
    def recover(self):
        running = [job for job in self.model.jobs.values() if job.state == "running"]
        assert self.ledger.recover() == len(running)
        for job in running:
            if job.cancel:
                job.end("cancelled", self.model.now)
            else:
                job.wait(self.model.now)

    @rule(ttl=st.sampled_from([1, 30, 1000]))
    def expire(self, ttl):
        expected = self.model.expire(ttl)
        assert set(self.ledger.expired(ttl)) == expected

    @invariant()
    def every_job_is_as_the_model_has_it(self):
        records = {record.id: record for record in self.ledger.page(None, limit=1000).records}
        assert records.keys() == self.model.jobs.keys()
        for id, job in self.model.jobs.items():
            record = records[id]
            error = record.error and record.error["slug"]
            assert (record.state, record.attempt, record.result_blob, error, tuple(record.progress)) == (
                *(job.state, job.attempt, job.result, job.error, job.progress),
            )
            times = (record.created_at, record.started_at, record.finished_at, record.expires_at)
            model_times = (job.created, job.started, job.finished, job.expires)
            assert times == tuple(map(self.at, model_times))
            assert (record.cancel_requested, record.keep_inputs) == (job.cancel, job.keep)

    @invariant()
    def versions_grow_with_every_change(self):
        for record in self.ledger.page(None, limit=1000).records:
            before = self.seen.get(record.id, record)
            assert record == before or record.version > before.version
            self.seen[record.id] = record

    @invariant()
    def no_job_finishes_twice(self):
        assert max(self.finished.values(), default=0) <= 1

    @invariant()
    def bytes_counts_and_blobs_agree(self):
        jobs = self.model.jobs.values()
        stats = self.ledger.stats()
        assert stats.bytes_held == sum(job.held for job in jobs)
        assert stats.bytes_reserved == sum(job.reserved for job in jobs if job.state in LIVE)
        counts = Counter(job.state for job in jobs)
        assert stats.counts == {state: counts[state] for state in JobState}
        waiting = [self.model.now - job.created for job in jobs if job.state == "queued"]
        assert stats.oldest_queued_s == max(waiting, default=0)
        assert self.ledger.known_blobs() == {name for job in jobs for name in job.blobs()}


def test_the_ledger_does_what_the_model_does(ledger, clock):
    run_state_machine_as_test(
        lambda: LedgerMachine(ledger, clock),
        settings=settings(
            max_examples=40,
            stateful_step_count=50,
            deadline=None,
            derandomize=True,
            suppress_health_check=list(HealthCheck),
        ),
    )
