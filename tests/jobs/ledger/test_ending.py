"""Results, errors, cancellation, retention, and lists."""

from datetime import timedelta

import pytest

from stereomend.errors import InvalidParameter, JobFinished, JobNotFound
from stereomend.jobs.records import JobState, Outcome, Progress

FAILURE = Outcome(error={"slug": "damaged-file", "detail": "left is truncated"})
STOPPED = Outcome(error={"slug": "job-cancelled", "detail": "it was cancelled"})


def test_a_finished_job_tells_all_that_its_worker_told(ledger, running, clock, success):
    claim = running()
    told = {
        "backend": "native",
        "device": "cpu",
        "timings_ms": {"gdr": 1.25, "total": 3.5},
        "meta": {"quality": {"kept": 0.5, "warnings": ["no-colour"]}, "version": "1"},
    }
    clock.move(3)
    assert ledger.finish(claim, success(claim, **told), 60)
    record = ledger.get(claim.id, None)
    assert {name: getattr(record, name) for name in told} == told
    assert record.quality == told["meta"]["quality"]
    assert (record.state, record.error) == (JobState.SUCCEEDED, None)
    assert (record.result_blob, record.result_sha256) == (f"results/{claim.id}.1", "cd" * 32)
    assert record.finished_at == clock.now
    assert record.expires_at == clock.now + timedelta(seconds=60)


def test_a_job_finishes_once(ledger, running, success):
    claim = running()
    assert ledger.finish(claim, success(claim), 60)
    before = ledger.get(claim.id, None)
    assert not ledger.finish(claim, success(claim), 600)
    assert not ledger.finish(claim, FAILURE, 600)
    assert ledger.get(claim.id, None) == before


def test_a_refused_input_is_a_failed_job(ledger, running):
    claim = running()
    assert ledger.finish(claim, FAILURE, 60)
    record = ledger.get(claim.id, None)
    assert (record.state, record.error) == (JobState.FAILED, FAILURE.error)
    assert record.expires_at is record.result_blob is None


@pytest.mark.parametrize("outcome", [Outcome(), Outcome(result_blob="results/x.1", error=FAILURE.error)])
def test_an_outcome_is_a_result_or_an_error(ledger, running, outcome):
    with pytest.raises(ValueError, match="either a result or an error"):
        ledger.finish(running(), outcome, 60)


def test_what_waits_is_cancelled_at_once(ledger, accepted, clock):
    job = accepted()
    cancelled = ledger.cancel(job.id, "ann")
    assert (cancelled.state, cancelled.finished_at, cancelled.error) == (JobState.CANCELLED, clock.now, None)
    assert ledger.claim(30) is None
    assert ledger.cancel(job.id, "ann") == cancelled == ledger.get(job.id, None)


def test_what_runs_is_asked_to_stop(ledger, running):
    claim = running()
    asked = ledger.cancel(claim.id, None)
    assert (asked.state, asked.cancel_requested) == (JobState.RUNNING, True)
    assert ledger.cancel(claim.id, None) == asked
    assert ledger.renew(claim, 30, Progress("gdr")) == (True, True)
    assert ledger.finish(claim, STOPPED, 60)
    record = ledger.get(claim.id, None)
    assert (record.state, record.error) == (JobState.CANCELLED, None)
    assert ledger.cancel(claim.id, None) == record


def test_a_result_that_was_faster_than_the_cancellation_counts(ledger, running, success):
    claim = running()
    ledger.cancel(claim.id, None)
    assert ledger.finish(claim, success(claim), 60)
    assert ledger.get(claim.id, None).state is JobState.SUCCEEDED


def test_what_has_ended_cannot_be_cancelled(ledger, running, success, clock):
    failed, done, expired = running(), running(), running()
    ledger.finish(failed, FAILURE, 60)
    ledger.finish(done, success(done), 60)
    ledger.finish(expired, success(expired), 1)
    clock.move(2)
    ledger.expired(1000)
    for claim, state in ((failed, "failed"), (done, "succeeded"), (expired, "expired")):
        with pytest.raises(JobFinished, match=state):
            ledger.cancel(claim.id, None)


def test_results_go_after_their_time_and_records_after_theirs(ledger, running, success, clock):
    claim = running()
    ledger.finish(claim, success(claim), 60)
    clock.move(59)
    assert ledger.expired(100) == []
    clock.move(1)
    assert ledger.expired(100) == [f"results/{claim.id}.1"]
    record = ledger.get(claim.id, None)
    assert (record.state, record.result_blob) == (JobState.EXPIRED, None)
    assert ledger.expired(100) == []
    clock.move(40)
    assert ledger.expired(100) == []
    with pytest.raises(JobNotFound):
        ledger.get(claim.id, None)


def test_a_record_that_goes_first_takes_all_blobs_with_it(ledger, running, success, clock):
    claim = running(keep_inputs=True)
    ledger.finish(claim, success(claim), 1000)
    clock.move(10)
    assert sorted(ledger.expired(10)) == [f"inputs/{claim.id}", f"results/{claim.id}.1"]
    assert ledger.known_blobs() == set()


def test_what_waits_or_runs_never_goes_by_itself(ledger, running, accepted, clock):
    jobs = [running().id, accepted().id]
    clock.move(10**9)
    assert ledger.expired(1) == []
    assert {ledger.get(id, None).id for id in jobs} == set(jobs)


def test_a_purged_job_is_gone_and_its_worker_has_lost_it(ledger, running, success):
    claim = running()
    assert sorted(ledger.purge(claim.id, "ann")) == [f"inputs/{claim.id}", f"results/{claim.id}.1"]
    with pytest.raises(JobNotFound):
        ledger.get(claim.id, None)
    assert not ledger.finish(claim, success(claim), 60)
    assert not ledger.renew(claim, 30, Progress("gdr")).held
    with pytest.raises(JobNotFound):
        ledger.purge(claim.id, "ann")


def test_the_blobs_that_count_are_those_of_jobs_that_need_them(ledger, running, accepted, success):
    done, kept, failed, busy = running(), running(keep_inputs=True), running(), running()
    waiting = accepted()
    ledger.finish(done, success(done), 60)
    ledger.finish(kept, success(kept), 60)
    ledger.finish(failed, FAILURE, 60)
    results = {f"results/{claim.id}.1" for claim in (done, kept, busy)}
    assert ledger.known_blobs() == results | {f"inputs/{job.id}" for job in (kept, busy, waiting)}


def test_pages_show_every_job_once_newest_first(ledger, accepted, clock):
    jobs = []
    for number in range(7):
        # Two at a time, for equal times must not hide one.
        clock.move(number % 2)
        jobs.append(accepted())
    newest = sorted(jobs, key=lambda job: (job.created_at, job.id), reverse=True)
    for limit in (1, 3, 7, 50):
        assert list(paged(ledger, limit)) == newest


def test_a_job_that_comes_between_two_pages_moves_nothing(ledger, accepted, clock):
    old = []
    for _ in range(4):
        clock.move(1)
        old.append(accepted())
    first = ledger.page("ann", limit=2)
    clock.move(1)
    accepted()
    second = ledger.page("ann", limit=2, cursor=first.next_cursor)
    assert first.records + second.records == old[::-1]
    assert second.next_cursor is None


def test_pages_show_the_jobs_of_an_owner_and_of_a_state(ledger, running, accepted):
    claim, bobs = running(owner="ann"), accepted(owner="bob")
    assert [record.id for record in ledger.page("ann").records] == [claim.id]
    assert ledger.page(None, state=JobState.QUEUED).records == [bobs]
    assert ledger.page("ann", state=JobState.FAILED) == ([], None)


@pytest.mark.parametrize("cursor", ["", "x", "é", "AAAA", "\0", "Zm9v" * 99, "ZmZmZiAyMDI0"])
def test_a_cursor_of_ones_own_making_is_refused(ledger, cursor):
    with pytest.raises(InvalidParameter, match="cursor"):
        ledger.page("ann", cursor=cursor)


def test_the_counts_say_how_full_it_is(ledger, accepted, running, clock):
    assert ledger.stats().oldest_queued_s == 0
    running()
    accepted()
    clock.move(7)
    accepted(bytes_held=1, bytes_reserved=2)
    stats = ledger.stats()
    assert {state: count for state, count in stats.counts.items() if count} == {"queued": 2, "running": 1}
    assert set(stats.counts) == set(JobState)
    assert (stats.oldest_queued_s, stats.bytes_held, stats.bytes_reserved) == (7, 2001, 1002)


def paged(ledger, limit):
    cursor, more = None, True
    while more:
        page = ledger.page("ann", limit=limit, cursor=cursor)
        assert len(page.records) <= limit
        yield from page.records
        cursor, more = page.next_cursor, page.next_cursor is not None
