"""The sweeper beside readers and writers."""

import os
import secrets
import threading
import time

import pytest

from stereomend.errors import JobNotFound, ResultExpired
from stereomend.jobs.blobs import BlobStore
from stereomend.jobs.ledger import Ledger
from stereomend.jobs.records import JobState, NewJob, Outcome, Room, inputs_blob, result_blob
from stereomend.jobs.sweeper import Sweeper

ROOM = Room(100, 10**9, 100, 10**9)


@pytest.fixture
def ledger(tmp_path):
    one = Ledger.open(f"sqlite:///{tmp_path}/ledger.sqlite")
    yield one
    one.close()


@pytest.fixture
def blobs(tmp_path):
    return BlobStore(tmp_path)


@pytest.fixture
def sweeper(ledger, blobs):
    return Sweeper(ledger, blobs, record_ttl_s=1000)


@pytest.fixture
def aged(tmp_path):
    """Make a blob look as if it was written so many seconds ago."""

    def age(name, seconds):
        then = time.time() - seconds
        os.utime(tmp_path / name, (then, then))

    return age


def new_job():
    id = secrets.token_hex(16)
    return NewJob(id, "ann", "paper", {}, {"sha256": "x"}, bytes_held=1, bytes_reserved=1)


def submit(ledger, blobs):
    job = new_job()
    blobs.put(inputs_blob(job.id), [b"inputs"])
    return ledger.accept(job, ROOM).record


def finish(ledger, blobs, result_ttl_s):
    submit(ledger, blobs)
    claim = ledger.claim(600)
    name = result_blob(claim.id, claim.attempt)
    blobs.put(name, [b"result"])
    ledger.finish(claim, Outcome(result_blob=name), result_ttl_s)
    return ledger.get(claim.id, None)


def names(blobs):
    return {blob.name for blob in blobs.names()}


def test_old_orphans_go_and_young_ones_may_be_on_their_way(sweeper, blobs, aged):
    old, young = inputs_blob("a" * 32), inputs_blob("b" * 32)
    for name in (old, young):
        blobs.put(name, [b"x"])
    aged(old, 3700)
    aged(young, 3500)
    assert [sweeper.sweep() for _ in range(3)] == [(0, 0), (0, 1), (0, 0)]
    assert names(blobs) == {young}


def test_an_orphan_that_is_accepted_after_a_jump_of_the_clock_stays(sweeper, ledger, blobs, aged):
    job = new_job()
    blobs.put(inputs_blob(job.id), [b"x"])
    aged(inputs_blob(job.id), 10**6)
    sweeper.sweep()
    ledger.accept(job, ROOM)
    assert [sweeper.sweep() for _ in range(2)] == [(0, 0), (0, 0)]
    assert names(blobs) == {inputs_blob(job.id)}


def test_what_a_writer_left_half_done_goes(sweeper, blobs, aged, tmp_path):
    name = f"results/{'a' * 32}.1.0123abcd.part"
    (tmp_path / name).write_bytes(b"half")
    aged(name, 3700)
    sweeper.sweep()
    sweeper.sweep()
    assert names(blobs) == set()


def test_files_of_jobs_stay_however_old(sweeper, ledger, blobs, aged):
    done = finish(ledger, blobs, 600)
    waiting = submit(ledger, blobs)
    for name in (done.result_blob, inputs_blob(waiting.id), inputs_blob(done.id)):
        aged(name, 10**6)
    for _ in range(3):
        sweeper.sweep()
    # Nobody deleted the inputs of the one that is done.
    assert names(blobs) == {done.result_blob, inputs_blob(waiting.id)}


def test_a_result_goes_after_its_time(sweeper, ledger, blobs):
    record = finish(ledger, blobs, 0)
    assert sweeper.sweep().expired == 1
    assert record.result_blob not in names(blobs)
    assert ledger.get(record.id, None).state is JobState.EXPIRED
    with pytest.raises(ResultExpired):
        blobs.result(record.result_blob)


def test_a_record_goes_after_its_time(ledger, blobs):
    record = finish(ledger, blobs, 0)
    Sweeper(ledger, blobs, record_ttl_s=0).sweep()
    with pytest.raises(JobNotFound):
        ledger.get(record.id, None)


def test_a_reader_that_has_opened_a_result_reads_it_to_its_end(sweeper, ledger, blobs, tmp_path):
    record = finish(ledger, blobs, 0)
    with (tmp_path / record.result_blob).open("rb") as reader:
        assert sweeper.sweep().expired == 1
        assert reader.read() == b"result"


def test_readers_beside_the_sweeper_get_the_result_or_that_it_has_expired(sweeper, ledger, blobs):
    records = [finish(ledger, blobs, 0) for _ in range(20)]
    answers, start = [], threading.Barrier(4, timeout=20)

    def read():
        start.wait()
        for record in records:
            try:
                answers.append(blobs.result(record.result_blob))
            except ResultExpired:
                answers.append(None)

    threads = [threading.Thread(target=read) for _ in range(3)]
    for thread in threads:
        thread.start()
    start.wait()
    assert sweeper.sweep().expired == 20
    for thread in threads:
        thread.join()
    assert len(answers) == 60
    assert set(answers) <= {b"result", None}


def test_a_job_accepted_while_the_sweeper_looks_stays(sweeper, ledger, blobs, aged, monkeypatch):
    job, found = new_job(), blobs.names
    blobs.put(inputs_blob(job.id), [b"x"])
    aged(inputs_blob(job.id), 3700)
    sweeper.sweep()

    def names_then_accept():
        yield from found()
        ledger.accept(job, ROOM)

    monkeypatch.setattr(blobs, "names", names_then_accept)
    assert sweeper.sweep() == (0, 0)
    assert blobs.get(inputs_blob(job.id)) == b"x"
