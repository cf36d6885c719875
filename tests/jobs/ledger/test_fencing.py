"""A worker that is stopped past its lease and goes on later."""

import signal
import subprocess
import sys

import pytest

from stereomend.jobs.blobs import BlobStore
from stereomend.jobs.records import JobState, Outcome, result_blob

WORKER = """
import sys
from pathlib import Path
from stereomend.jobs.blobs import BlobStore
from stereomend.jobs.ledger import Ledger
from stereomend.jobs.records import Outcome, Progress, result_blob

ledger, blobs = Ledger.open(sys.argv[1]), BlobStore(Path(sys.argv[2]))
claim = ledger.claim(0.2)
print(claim.attempt, flush=True)
sys.stdin.readline()
name = result_blob(claim.id, claim.attempt)
blobs.put(name, [b"late"])
print(ledger.renew(claim, 30, Progress("encode")).held, flush=True)
print(ledger.finish(claim, Outcome(result_blob=name), 60), flush=True)
"""


@pytest.fixture
def worker(url, tmp_path):
    command = [sys.executable, "-c", WORKER, url, str(tmp_path / "blobs")]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    yield process
    process.kill()
    process.communicate()


@pytest.mark.parametrize("other", ["has finished", "still works"])
def test_a_worker_stopped_past_its_lease_cannot_overwrite(
    open_ledger, url, worker, tmp_path, new_job, plenty, eventually, other
):
    blobs = BlobStore(tmp_path / "blobs")
    with open_ledger(url) as ledger:
        id = ledger.accept(new_job(), plenty).record.id
        assert worker.stdout.readline() == "1\n"
        worker.send_signal(signal.SIGSTOP)
        eventually(lambda: ledger.reap().queued == [id])
        claim = ledger.claim(600)
        name = result_blob(id, claim.attempt)
        blobs.put(name, [b"in time"])
        if other == "has finished":
            assert ledger.finish(claim, Outcome(result_blob=name), 600)
        before = ledger.get(id, None)

        worker.stdin.write("\n")
        worker.stdin.flush()
        worker.send_signal(signal.SIGCONT)
        assert [worker.stdout.readline() for _ in range(2)] == ["False\n", "False\n"]
        assert worker.wait(20) == 0
        assert ledger.get(id, None) == before
        if other == "still works":
            assert ledger.finish(claim, Outcome(result_blob=name), 600)
        record = ledger.get(id, None)
        assert (record.state, record.result_blob, record.attempt) == (JobState.SUCCEEDED, name, 2)
        assert blobs.get(name) == b"in time"
        assert result_blob(id, 1) not in ledger.known_blobs()
