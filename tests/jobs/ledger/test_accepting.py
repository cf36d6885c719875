"""What the ledger takes, and what it refuses."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone

import pytest
from sqlalchemy.exc import StatementError

from stereomend.errors import DiskFull, IdempotencyMismatch, JobNotFound, QueueFull, QuotaExceeded
from stereomend.jobs.records import JobState, Progress


def test_an_accepted_job_waits_and_is_as_it_was_sent(ledger, new_job, plenty, clock):
    deadline = datetime(2024, 3, 1, 5, 0, 0, 7, timezone(timedelta(hours=2)))
    job = new_job(priority=-3, keep_inputs=True, request_id="r-1", deadline=deadline)
    accepted = ledger.accept(job, plenty)
    assert not accepted.replayed
    assert accepted.claim is None
    record = accepted.record
    for name in (
        "id",
        "owner",
        "preset",
        "params",
        "input",
        "priority",
        "keep_inputs",
        "request_id",
        "deadline",
    ):
        assert getattr(record, name) == getattr(job, name)
    assert (record.state, record.attempt, record.progress) == (JobState.QUEUED, 0, Progress("queue"))
    assert record.created_at == clock.now
    assert record.created_at.tzinfo is record.deadline.tzinfo is UTC
    assert record == ledger.get(job.id, job.owner)


def test_it_is_still_there_when_the_ledger_is_opened_again(url, open_ledger, new_job, plenty):
    with open_ledger(url) as ledger:
        record = ledger.accept(new_job(), plenty).record
    with open_ledger(url) as ledger:
        assert ledger.get(record.id, None) == record


def test_a_job_can_be_accepted_while_it_runs(ledger, new_job, plenty, clock):
    accepted = ledger.accept(new_job(), plenty, claimed_for_s=10)
    assert accepted.record.state is JobState.RUNNING
    assert (accepted.claim.id, accepted.claim.attempt) == (accepted.record.id, 1)
    assert ledger.claim(10) is None
    clock.move(11)
    assert ledger.reap().queued == [accepted.record.id]


@pytest.mark.parametrize("id", ["f" * 32, "", "x", "\0", "é" * 32, "F" * 32, "f" * 32 + "\n", "f" * 99])
def test_any_text_may_be_asked_for_as_an_id(ledger, id):
    for ask in (ledger.get, ledger.cancel, ledger.purge):
        with pytest.raises(JobNotFound):
            ask(id, None)


def test_a_job_of_another_key_is_not_found(ledger, accepted):
    job = accepted(owner="ann")
    for ask in (ledger.get, ledger.cancel, ledger.purge):
        with pytest.raises(JobNotFound):
            ask(job.id, "bob")
    assert ledger.get(job.id, None) == job


def test_the_same_key_with_the_same_body_gives_the_same_job(ledger, new_job, plenty):
    first = ledger.accept(new_job(idempotency_key="frame 17"), plenty).record
    ledger.claim(30)
    again = ledger.accept(new_job(idempotency_key="frame 17"), plenty)
    assert again.replayed
    assert again.record == ledger.get(first.id, None)
    assert ledger.stats().counts[JobState.RUNNING] == sum(ledger.stats().counts.values()) == 1


@pytest.mark.parametrize("other", [{"input": {"sha256": "0" * 64}}, {"params": {"preset": "robust"}}])
def test_the_same_key_with_another_body_is_refused(ledger, new_job, plenty, other):
    first = ledger.accept(new_job(idempotency_key="k"), plenty).record
    with pytest.raises(IdempotencyMismatch, match=first.id):
        ledger.accept(new_job(idempotency_key="k", **other), plenty)


def test_another_owner_may_use_the_same_key(ledger, new_job, plenty):
    jobs = [ledger.accept(new_job(idempotency_key="k", owner=owner), plenty) for owner in ("ann", "bob")]
    assert not any(job.replayed for job in jobs)


def test_a_replay_needs_no_room(ledger, new_job, plenty):
    ledger.accept(new_job(idempotency_key="k"), plenty)
    nothing = replace(plenty, most_jobs=0, free_disk_bytes=0)
    assert ledger.accept(new_job(idempotency_key="k"), nothing).replayed


def test_a_key_can_be_used_again_when_its_job_is_purged(ledger, new_job, plenty):
    first = ledger.accept(new_job(idempotency_key="k"), plenty).record
    ledger.purge(first.id, None)
    assert not ledger.accept(new_job(idempotency_key="k"), plenty).replayed


@pytest.mark.parametrize(
    ("room", "error"),
    [
        ({"most_jobs": 2}, QueueFull),
        ({"most_bytes": 2999}, QueueFull),
        ({"most_jobs_of_owner": 1}, QuotaExceeded),
        ({"free_disk_bytes": 1499}, DiskFull),
    ],
)
def test_what_has_no_room_is_refused_until_a_job_ends(ledger, accepted, new_job, plenty, room, error):
    waiting = [accepted(owner="ann"), accepted(owner="bob")]
    room = replace(plenty, **room)
    with pytest.raises(error):
        ledger.accept(new_job(owner="ann"), room)
    assert sum(ledger.stats().counts.values()) == 2
    ledger.cancel(waiting[0].id, None)
    ledger.accept(new_job(owner="ann"), room)


def test_running_jobs_take_room_too(ledger, running, new_job, plenty):
    running()
    with pytest.raises(QueueFull, match="1 jobs"):
        ledger.accept(new_job(), replace(plenty, most_jobs=1))


def test_a_job_too_large_to_wait_with_others_is_accepted_alone(ledger, new_job, plenty):
    ledger.accept(new_job(bytes_held=10**6), replace(plenty, most_bytes=10))


def test_the_bytes_of_inputs_that_are_kept_are_told_but_take_no_room(
    ledger, running, new_job, plenty, success
):
    claim = running(keep_inputs=True)
    ledger.finish(claim, success(claim), 60)
    assert (ledger.stats().bytes_held, ledger.stats().bytes_reserved) == (1000, 0)
    ledger.accept(new_job(), replace(plenty, most_jobs=1, most_bytes=1000, free_disk_bytes=500))


def test_what_is_no_json_is_refused_on_both_databases(ledger, new_job, plenty):
    with pytest.raises((ValueError, StatementError), match="not JSON compliant"):
        ledger.accept(new_job(params={"x": float("nan")}), plenty)
    assert sum(ledger.stats().counts.values()) == 0
