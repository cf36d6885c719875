"""Many threads and processes at one ledger."""

import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import replace

from stereomend.errors import JobFinished, QueueFull
from stereomend.jobs.records import JobState, Progress

CLAIM_ALL = """
import sys
from stereomend.jobs.ledger import Ledger
ledger = Ledger.open(sys.argv[1])
print("ready", flush=True)
sys.stdin.readline()
while claim := ledger.claim(600):
    print(claim.id, claim.attempt)
"""


def at_once(count, call):
    """Call in as many threads, which start together; returns results and errors."""
    start = threading.Barrier(count, timeout=60)

    def one(number):
        start.wait()
        try:
            return call(number)
        except Exception as error:
            return error

    with ThreadPoolExecutor(count) as threads:
        return list(threads.map(one, range(count)))


def claim_all(ledger):
    claims = []
    while claim := ledger.claim(600):
        claims.append(claim)
    return claims


def test_threads_that_claim_at_once_share_the_jobs_out(ledger, accepted):
    ids = {accepted().id for _ in range(40)}
    claims = [claim for some in at_once(8, lambda _: claim_all(ledger)) for claim in some]
    assert len(claims) == 40
    assert {claim.id for claim in claims} == ids
    assert {claim.attempt for claim in claims} == {1}


def test_processes_that_claim_at_once_share_the_jobs_out(ledger, url, accepted):
    ids = [accepted().id for _ in range(60)]
    command = [sys.executable, "-c", CLAIM_ALL, url]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with ExitStack() as stack:
        processes = [stack.enter_context(subprocess.Popen(command, **pipes)) for _ in range(3)]
        for process in processes:
            stack.callback(process.kill)
            assert process.stdout.readline() == "ready\n"
        for process in processes:
            process.stdin.write("\n")
            process.stdin.flush()
        said = [line for process in processes for line in process.communicate(timeout=60)[0].splitlines()]
    assert [process.returncode for process in processes] == [0, 0, 0]
    assert sorted(said) == sorted(f"{id} 1" for id in ids)


def test_one_idempotency_key_at_once_makes_one_job(ledger, new_job, plenty):
    answers = at_once(8, lambda _: ledger.accept(new_job(idempotency_key="k"), plenty))
    assert len({answer.record.id for answer in answers}) == 1
    assert [answer.replayed for answer in answers].count(False) == 1
    assert sum(ledger.stats().counts.values()) == 1


def test_no_more_jobs_are_accepted_at_once_than_there_is_room_for(ledger, new_job, plenty):
    room = replace(plenty, most_jobs=5)
    answers = at_once(12, lambda _: ledger.accept(new_job(), room))
    assert sum(isinstance(answer, QueueFull) for answer in answers) == 7
    assert ledger.stats().counts[JobState.QUEUED] == 5


def test_of_those_that_finish_one_claim_at_once_one_does(ledger, running, success):
    claim = running()
    assert sorted(at_once(6, lambda _: ledger.finish(claim, success(claim), 60))) == [False] * 5 + [True]


def test_a_job_is_either_cancelled_or_claimed(ledger, accepted):
    for _ in range(10):
        job = accepted()
        cancelled, claim = at_once(
            2, lambda number, id=job.id: ledger.claim(600) if number else ledger.cancel(id, None)
        )
        record = ledger.get(job.id, None)
        if cancelled.state is JobState.CANCELLED:
            assert (claim, record.state) == (None, JobState.CANCELLED)
        else:
            assert (claim.id, record.state) == (job.id, JobState.RUNNING)
            assert record.cancel_requested


def test_everything_at_once_neither_fails_nor_loses_a_job(ledger, accepted, new_job, plenty, success):
    """Deadlocks would show here: workers, clients, the reaper and the sweeper, all on the same rows."""
    for _ in range(6):
        accepted()

    def work(number):
        for round in range(8):
            if number < 3 and (claim := ledger.claim(600)):
                ledger.renew(claim, 600, Progress("gdr", round))
                if round % 3 == 2:
                    ledger.release(claim)
                else:
                    ledger.finish(claim, success(claim), 600)
            elif number == 3:
                ledger.accept(new_job(), plenty)
            elif number == 4:
                cancel_oldest(ledger)
            elif number == 5:
                ledger.reap()
                ledger.expired(600)
                ledger.stats()

    assert at_once(6, work) == [None] * 6
    for claim in claim_all(ledger):
        assert ledger.finish(claim, success(claim), 600)
    counts = ledger.stats().counts
    assert counts[JobState.SUCCEEDED] + counts[JobState.CANCELLED] == sum(counts.values()) == 14


def cancel_oldest(ledger):
    records = ledger.page(None, JobState.QUEUED).records
    if records:
        with suppress(JobFinished):
            ledger.cancel(records[-1].id, None)
