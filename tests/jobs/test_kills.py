"""What is accepted ends with the right bytes, whoever is killed: real processes, real signals."""

import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stereomend.codec import render
from stereomend.jobs.blobs import BlobStore
from stereomend.jobs.ledger import Ledger
from stereomend.jobs.records import MOST_CRASHES, JobState
from stereomend.jobs.task import Task, perform
from stereomend.refinement import parse_params, select_backend

PROGRAMS = Path(__file__).parent / "programs"
NPY = "application/x-npy"
QUICK = {"gdr": {"warps": 1, "levels": 1}}
SLOW = {"gdr": {"warps": 20, "iterations": 60, "levels": 1}, "processing_scale": 1.0}
POINTS = [
    "rename of the inputs",
    "insert",
    "commit",
    "claim",
    "rename of the result",
    "end in the ledger",
]


class Jobs:
    """A supervised server of jobs, seen from outside."""

    def __init__(self, folder, children):
        self.folder = folder
        self.children = children
        self.seen = set()
        self.accepted = {}
        self.start()

    def start(self):
        command = [sys.executable, PROGRAMS / "supervise.py", sys.executable, PROGRAMS / "jobs_server.py"]
        self.log = (self.folder / "log").open("a")
        self.supervisor = subprocess.Popen(
            [*map(str, command), str(self.folder)], stdout=subprocess.PIPE, stderr=self.log, text=True
        )
        self.port = int(self.supervisor.stdout.readline())

    def end(self, number=signal.SIGTERM):
        """End the supervisor; returns its exit code."""
        self.processes()
        self.supervisor.send_signal(number)
        code = self.supervisor.wait(60)
        self.supervisor.stdout.close()
        self.log.close()
        return code

    def processes(self):
        """The processes below the supervisor by kind, each with all that it started."""
        api = [pid for pid in self.children(self.supervisor.pid) if b"jobs_server" in command(pid)]
        workers = [pid for pid in self.children(api[0]) if b"spawn_main" in command(pid)] if api else []
        self.seen |= {self.supervisor.pid, *api, *(pid for parent in api for pid in self.children(parent))}
        return {"api": api, "worker": workers, "supervisor": [self.supervisor.pid]}

    def submit(self, params):
        """Send a job until it is accepted."""
        while True:
            try:
                with socket.create_connection(("127.0.0.1", self.port), 60) as connection:
                    connection.sendall(json.dumps(params).encode() + b"\n")
                    id = connection.recv(64).decode()
            except ConnectionError:
                continue
            if id:
                self.accepted[id] = params
                return id

    def kill(self, kind):
        pids = self.processes()[kind]
        if not pids:
            return
        if kind == "supervisor":
            self.end(signal.SIGKILL)
            self.start()
        else:
            os.kill(random.choice(pids), signal.SIGKILL)


def command(pid):
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return b""


@pytest.fixture
def start(tmp_path, scene, children):
    """Start a server of jobs, which dies at a point of its work if one is named."""
    running = []
    for name, content in scene.files.items():
        (tmp_path / f"{name}.npy").write_bytes(content)

    def begin(point=None):
        if point:
            (tmp_path / "doom").write_text(point)
        running.append(Jobs(tmp_path, children))
        return running[-1]

    yield begin
    for jobs in running:
        if jobs.supervisor.poll() is None:
            jobs.end()


@pytest.fixture
def check(scene, eventually, alive):
    """See that every accepted job succeeds, with the bytes that this process computes, and nobody is left."""
    expected = {}

    def map_of(params):
        key = json.dumps(params)
        if key not in expected:
            task = Task(**scene.files, params=parse_params(params), media_type=NPY)
            expected[key] = perform(task, select_backend("reference"), 10**6).body
        return expected[key]

    def run(jobs, seconds=120):
        ledger = Ledger.open(f"sqlite:///{jobs.folder / 'data' / 'ledger.sqlite'}")
        try:
            ids = {record.id for record in ledger.page(None, limit=500).records}
            assert set(jobs.accepted) <= ids
            eventually(lambda: all(ledger.get(id, None).state.final for id in ids), seconds)
            records = [ledger.get(id, None) for id in ids]
        finally:
            ledger.close()
        blobs = BlobStore(jobs.folder / "data")
        for record in records:
            assert record.state is JobState.SUCCEEDED, record.error
            body = render(blobs.get(record.result_blob), NPY)
            assert body in map(map_of, (QUICK, SLOW))
            if record.id in jobs.accepted:
                assert body == map_of(jobs.accepted[record.id])
        assert jobs.end() == 0
        eventually(lambda: not any(map(alive, jobs.seen)))
        return records

    return run


@pytest.mark.parametrize("point", POINTS)
def test_a_job_survives_the_death_of_the_server(start, check, point):
    jobs = start(point)
    jobs.submit(QUICK)
    records = check(jobs)
    assert not (jobs.folder / "doom").exists(), "it never died"
    assert len(records) == (2 if point == "commit" else 1)


@pytest.mark.parametrize("kind", ["worker", "api", "supervisor"])
def test_jobs_survive_the_death_of_a_process_at_work_and_at_rest(start, check, kind, eventually):
    jobs = start()
    eventually(lambda: jobs.processes()["worker"])
    jobs.kill(kind)
    eventually(lambda: jobs.processes()["worker"])
    for params in (SLOW, QUICK, SLOW):
        jobs.submit(params)
    jobs.kill(kind)
    check(jobs)


def test_jobs_survive_many_deaths(start, check, eventually):
    dice, jobs = random.Random(5), start()
    ledger = Ledger.open(f"sqlite:///{jobs.folder / 'data' / 'ledger.sqlite'}")

    def nobody_is_worn_out():
        # Hit once more, a job in its last attempt would be taken for poison.
        return all(record.attempt < MOST_CRASHES for record in ledger.page(None, JobState.RUNNING).records)

    for _ in range(12):
        for _ in range(dice.randrange(3)):
            jobs.submit(QUICK)
        time.sleep(0.5 * dice.random())
        eventually(nobody_is_worn_out)
        jobs.kill(dice.choice(["worker", "worker", "api", "supervisor"]))
    ledger.close()
    check(jobs)


def test_a_server_that_is_told_to_end_loses_nothing(start, check, children, tmp_path):
    jobs = start()
    for params in (SLOW, QUICK, SLOW):
        jobs.submit(params)
    assert jobs.end() == 0
    again = Jobs(tmp_path, children)
    again.accepted, again.seen = jobs.accepted, jobs.seen
    check(again)


def test_a_stopped_server_that_goes_on_ends_no_job_twice(start, check, eventually):
    jobs = start()
    id = jobs.submit(SLOW)
    (api,) = jobs.processes()["api"]
    os.kill(api, signal.SIGSTOP)
    time.sleep(6)  # longer than the lease
    os.kill(api, signal.SIGCONT)
    (record,) = check(jobs)
    assert record.id == id


def test_a_workers_death_while_the_server_is_stopped_leaves_no_orphan(start, alive, eventually):
    jobs = start()
    eventually(lambda: jobs.processes()["worker"])
    jobs.submit(SLOW)
    found = jobs.processes()
    for pid in (*found["worker"], *found["api"]):
        os.kill(pid, signal.SIGSTOP)
    jobs.end(signal.SIGKILL)
    eventually(lambda: not any(map(alive, jobs.seen)))
