"""Claims, leases, and what becomes of jobs whose workers are lost."""

from datetime import timedelta

import pytest

from stereomend.jobs.records import MOST_CRASHES, JobState, Progress

GDR = Progress("gdr", 3, 50)


def test_the_highest_priority_runs_first_and_among_equals_the_oldest(ledger, accepted, clock):
    jobs = {}
    for name, priority in [("c", 0), ("a", 9), ("d", 0), ("b", 9), ("e", -1)]:
        clock.move(1)
        jobs[accepted(priority=priority).id] = name
    assert "".join(jobs[ledger.claim(30).id] for _ in jobs) == "abcde"
    assert ledger.claim(30) is None


def test_a_claim_says_what_a_worker_needs(ledger, accepted, clock):
    job = accepted(keep_inputs=True, request_id="r-9")
    clock.move(2)
    claim = ledger.claim(30)
    for name in ("id", "params", "keep_inputs", "request_id", "created_at"):
        assert getattr(claim, name) == getattr(job, name)
    record = ledger.get(job.id, None)
    assert (record.state, record.attempt, claim.attempt) == (JobState.RUNNING, 1, 1)
    assert record.started_at == clock.now
    assert record.version > job.version


def test_a_lease_that_is_renewed_is_not_reaped(ledger, running, clock):
    claim = running()
    for _ in range(3):
        clock.move(29)
        assert ledger.renew(claim, 30, GDR) == (True, False)
        assert ledger.reap() == ([], [], [])
    clock.move(31)
    assert ledger.reap().queued == [claim.id]


def test_progress_is_a_new_version_and_a_bare_renewal_is_not(ledger, running):
    claim = running()
    before = ledger.get(claim.id, None)
    ledger.renew(claim, 30, GDR)
    moved = ledger.get(claim.id, None)
    assert moved.progress == GDR
    assert moved.version > before.version
    ledger.renew(claim, 30, GDR)
    assert ledger.get(claim.id, None) == moved


def test_a_lost_claim_changes_nothing(ledger, running, clock, success):
    lost = running()
    clock.move(31)
    ledger.reap()
    current = ledger.claim(30)
    assert (current.id, current.attempt) == (lost.id, 2)
    before = ledger.get(lost.id, None)
    assert ledger.renew(lost, 30, GDR) == (False, False)
    assert not ledger.finish(lost, success(lost), 60)
    assert not ledger.release(lost)
    assert ledger.crash(lost, "late") is None
    assert ledger.get(lost.id, None) == before
    assert ledger.finish(current, success(current), 60)
    assert ledger.get(lost.id, None).result_blob == success(current).result_blob


def test_a_lease_that_is_over_is_still_good_until_somebody_takes_the_job(ledger, running, clock, success):
    claim = running()
    clock.move(1000)
    assert ledger.finish(claim, success(claim), 60)


def test_a_released_job_waits_again_without_blame(ledger, running):
    claim = running()
    for attempt in range(2, 10):
        assert ledger.release(claim)
        record = ledger.get(claim.id, None)
        assert (record.state, record.started_at) == (JobState.QUEUED, None)
        claim = ledger.claim(30)
        assert claim.attempt == attempt


def test_a_job_released_for_a_while_is_not_claimed_before(ledger, running, accepted, clock):
    claim, other = running(priority=5), accepted()
    ledger.release(claim, delay_s=10)
    assert ledger.claim(30).id == other.id
    assert ledger.claim(30) is None
    clock.move(10)
    assert ledger.claim(30).id == claim.id


def lose_by_crash(ledger, claim, clock):
    return ledger.crash(claim, "signal 9")


def lose_by_lease(ledger, claim, clock):
    clock.move(31)
    reaped = ledger.reap()
    return JobState.QUEUED if reaped.queued else JobState.FAILED


def lose_by_end_of_server(ledger, claim, clock):
    assert ledger.recover() == 1
    return ledger.get(claim.id, None).state


@pytest.mark.parametrize("lose", [lose_by_crash, lose_by_lease, lose_by_end_of_server])
def test_a_job_that_loses_its_workers_again_and_again_is_poison(ledger, running, clock, lose):
    claim = running()
    for _ in range(MOST_CRASHES - 1):
        assert lose(ledger, claim, clock) is JobState.QUEUED
        claim = ledger.claim(30)
    assert lose(ledger, claim, clock) is JobState.FAILED
    record = ledger.get(claim.id, None)
    assert record.error["slug"] == "poison-job"
    assert record.finished_at == clock.now
    assert (ledger.stats().bytes_held, ledger.stats().bytes_reserved) == (0, 0)
    assert ledger.claim(30) is None


@pytest.mark.parametrize("lose", [lose_by_crash, lose_by_lease, lose_by_end_of_server])
def test_a_job_to_be_cancelled_is_not_run_again(ledger, running, clock, lose):
    claim = running()
    ledger.cancel(claim.id, None)
    lose(ledger, claim, clock)
    assert ledger.get(claim.id, None).state is JobState.CANCELLED


def test_a_job_to_be_cancelled_is_cancelled_when_it_is_released(ledger, running):
    claim = running()
    ledger.cancel(claim.id, None)
    assert ledger.release(claim)
    assert ledger.get(claim.id, None).state is JobState.CANCELLED


def test_nothing_is_recovered_that_does_not_run(ledger, accepted, running, success):
    claim = running()
    ledger.finish(claim, success(claim), 60)
    waiting = accepted()
    assert ledger.recover() == 0
    assert ledger.get(waiting.id, None) == waiting


def test_a_job_that_waits_past_its_deadline_is_not_claimed_and_fails(ledger, accepted, clock):
    job = accepted(deadline=clock.now + timedelta(seconds=5))
    clock.move(5)
    assert ledger.claim(30) is None
    reaped = ledger.reap()
    assert (reaped.queued, reaped.ended, reaped.blobs) == ([], [job.id], [f"inputs/{job.id}"])
    record = ledger.get(job.id, None)
    assert (record.state, record.error["slug"]) == (JobState.FAILED, "deadline-exceeded")


def test_a_job_that_runs_at_its_deadline_runs_on(ledger, running, clock, success):
    claim = running(deadline=clock.now + timedelta(seconds=5))
    clock.move(6)
    ledger.reap()
    assert ledger.finish(claim, success(claim), 60)


def test_inputs_that_are_to_be_kept_are_not_named_for_deletion(ledger, accepted, clock):
    job = accepted(deadline=clock.now, keep_inputs=True)
    assert ledger.reap() == ([], [job.id], [])
    assert ledger.known_blobs() == {f"inputs/{job.id}"}
