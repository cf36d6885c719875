"""Durable jobs in this process, with real workers and a real data folder."""

import asyncio
import os
import signal
import time
from contextlib import asynccontextmanager, suppress
from multiprocessing import active_children

import pytest

from stereomend.codec import render
from stereomend.errors import (
    ConfigurationError,
    DamagedFile,
    DiskFull,
    IdempotencyInFlight,
    IdempotencyMismatch,
    JobCancelled,
    JobFailed,
    JobFinished,
    JobNotFinished,
    JobNotFound,
    NotReady,
    QuotaExceeded,
)
from stereomend.jobs.pool import WorkerPool
from stereomend.jobs.records import JobState
from stereomend.jobs.service import JobService
from stereomend.jobs.task import Answer, Task, perform
from stereomend.refinement import select_backend
from stereomend.settings import load_settings

NPY = "application/x-npy"
SLOW = {"gdr": {"warps": 400, "iterations": 60, "levels": 1}, "processing_scale": 1.0}
ENDLESS = {"gdr": {"warps": 1000, "iterations": 1000, "levels": 1}, "processing_scale": 1.0}


@pytest.fixture
def serve(tmp_path):
    """Run a coroutine function with a service: `serve(scenario, lease_s=2)`."""

    def start(scenario, folder=tmp_path / "data", **settings):
        async def run():
            async with service(folder, **settings) as jobs:
                return await asyncio.wait_for(scenario(jobs), 120)

        return asyncio.run(run())

    return start


@asynccontextmanager
async def service(folder, grace_s=0.0, **settings):
    settings = load_settings(**{"backend": "reference", "data_dir": folder, "min_free_disk_mb": 0} | settings)
    pool = WorkerPool(settings)
    jobs = JobService(settings, pool)
    try:
        await jobs.start()
        await pool.start()
        yield jobs
    finally:
        await jobs.stop(grace_s)


async def until(jobs, id, *states):
    """Wait until a job is in one of these states."""
    record = await jobs.get(id, None)
    while record.state not in states:
        record = await jobs.changed(id, None, record.version, 60)
    return record


async def at_work(jobs, id, attempt=1):
    """Wait until a worker has told that it works on a job: `running` says that the job is claimed for one."""
    while True:
        record, ticket = await jobs.get(id, None), jobs._runner._running.get(id)
        if record.attempt == attempt and ticket and ticket.heard_at > ticket.started_at > 0:
            return
        await asyncio.sleep(0.02)


async def ended(jobs, id):
    return await until(jobs, id, *(state for state in JobState if state.final))


def files_in(folder):
    return sorted(path.name for kind in ("inputs", "results") for path in (folder / kind).iterdir())


def map_of(submission):
    """What this process computes, as NPY."""
    task = Task(**vars(submission.files), params=submission.params, media_type=NPY)
    return perform(task, select_backend("reference"), 10**6).body


async def result_of(jobs, id):
    return render((await jobs.result(id, None)).content, NPY)


def test_a_job_ends_with_the_bytes_that_this_process_computes(serve, submission, tmp_path):
    async def scenario(jobs):
        accepted = await jobs.submit(submission())
        assert accepted.record.state is JobState.QUEUED
        record = await ended(jobs, accepted.record.id)
        assert record.state is JobState.SUCCEEDED
        assert record.attempt == 1
        assert record.backend == "reference"
        assert record.timings_ms["total"] > 0
        assert record.input["width"] == 64
        assert files_in(tmp_path / "data") == [f"{record.id}.1"], "the inputs are gone"
        return await result_of(jobs, record.id)

    assert serve(scenario) == map_of(submission())


def test_a_job_waits_for_the_next_server(serve, submission):
    async def submit(jobs):
        running = await jobs.submit(submission(SLOW))
        await until(jobs, running.record.id, JobState.RUNNING)
        return running.record.id, (await jobs.submit(submission())).record.id

    async def collect(jobs):
        for id in ids:
            record = await ended(jobs, id)
            assert record.state is JobState.SUCCEEDED, record.error
        return [await result_of(jobs, id) for id in ids]

    ids = serve(submit)
    assert serve(collect) == [map_of(submission(SLOW)), map_of(submission())]


@pytest.mark.parametrize("reading_s", [0, 0.3])
def test_what_runs_is_finished_within_the_grace(submission, tmp_path, reading_s):
    async def scenario():
        async with service(tmp_path, grace_s=60) as jobs:
            blobs = jobs.store.blobs
            read, blobs.get = blobs.get, lambda name: (time.sleep(reading_s), read(name))[1]
            id = (await jobs.submit(submission(SLOW))).record.id
            await until(jobs, id, JobState.RUNNING)
        async with service(tmp_path) as jobs:
            record = await jobs.get(id, None)
            assert (record.state, record.attempt) == (JobState.SUCCEEDED, 1)

    asyncio.run(scenario())


def test_a_waiting_job_is_cancelled_at_once_and_a_running_one_soon(serve, submission, tmp_path):
    async def scenario(jobs):
        running = (await jobs.submit(submission(ENDLESS))).record.id
        waiting = (await jobs.submit(submission())).record.id
        await until(jobs, running, JobState.RUNNING)
        assert (await jobs.cancel(waiting, "local")).state is JobState.CANCELLED
        assert (await jobs.cancel(running, "local")).cancel_requested
        assert (await ended(jobs, running)).state is JobState.CANCELLED
        for id in (running, waiting):
            with pytest.raises(JobCancelled):
                await jobs.result(id, "local")
            assert (await jobs.cancel(id, "local")).state is JobState.CANCELLED
        done = (await jobs.submit(submission())).record.id
        await ended(jobs, done)
        with pytest.raises(JobFinished):
            await jobs.cancel(done, "local")
        assert files_in(tmp_path / "data") == [f"{done}.1"]

    serve(scenario)


def test_progress_is_told_while_a_job_runs(serve, submission):
    async def scenario(jobs):
        record = (await jobs.submit(submission(ENDLESS))).record
        seen = []
        while len(seen) < 3:
            record = await jobs.changed(record.id, None, record.version, 30)
            if record.progress.phase == "gdr" and record.progress not in seen:
                seen.append(record.progress)
        await jobs.cancel(record.id, None)
        return seen

    seen = serve(scenario)
    assert [step.done for step in seen] == sorted({step.done for step in seen})
    assert {step.total for step in seen} == {1000}


def test_the_job_of_a_killed_worker_runs_again(serve, submission):
    async def scenario(jobs):
        id = (await jobs.submit(submission(SLOW))).record.id
        await at_work(jobs, id)
        (worker,) = active_children()
        os.kill(worker.pid, signal.SIGKILL)
        record = await ended(jobs, id)
        assert (record.state, record.attempt) == (JobState.SUCCEEDED, 2)
        return await result_of(jobs, id)

    assert serve(scenario) == map_of(submission(SLOW))


def test_a_job_that_kills_its_workers_is_poison(serve, submission):
    async def scenario(jobs):
        id = (await jobs.submit(submission(ENDLESS))).record.id
        for attempt in range(1, 4):
            await at_work(jobs, id, attempt)
            for worker in active_children():
                os.kill(worker.pid, signal.SIGKILL)
        assert (await ended(jobs, id)).state is JobState.FAILED
        with pytest.raises(JobFailed, match="poison-job"):
            await jobs.result(id, None)

    serve(scenario)


def test_a_silent_worker_loses_its_job_and_says_nothing_more(serve, submission):
    async def scenario(jobs):
        id = (await jobs.submit(submission(SLOW))).record.id
        await at_work(jobs, id)
        (worker,) = active_children()
        os.kill(worker.pid, signal.SIGSTOP)
        record = await ended(jobs, id)
        assert (record.state, record.attempt) == (JobState.SUCCEEDED, 2)
        assert not worker.is_alive()
        return await result_of(jobs, id)

    assert serve(scenario, lease_s=3) == map_of(submission(SLOW))


def test_a_request_that_takes_too_long_becomes_a_job(serve, submission):
    async def scenario(jobs):
        at_once = await jobs.refine(submission(), NPY, 60)
        assert isinstance(at_once, Answer)
        running = await jobs.refine(submission(SLOW), NPY, 0.2)
        waiting = await jobs.refine(submission(), NPY, 0.2)
        assert running.record.state is JobState.RUNNING
        assert waiting.record.state is JobState.QUEUED
        for accepted in (running, waiting):
            record = await ended(jobs, accepted.record.id)
            assert (record.state, record.attempt) == (JobState.SUCCEEDED, 1)
        return at_once.body, *[await result_of(jobs, job.record.id) for job in (running, waiting)]

    quick, slow = map_of(submission()), map_of(submission(SLOW))
    assert serve(scenario) == (quick, slow, quick)


def test_a_request_leaves_nothing_on_the_disk(serve, submission, tmp_path):
    async def scenario(jobs):
        await jobs.refine(submission(), NPY)
        assert files_in(tmp_path / "data") == []
        assert (await jobs.page(None)).records == []

    serve(scenario)


def test_requests_come_first_but_jobs_get_every_fourth_turn(serve, submission):
    order = []

    async def scenario(jobs):
        async def request():
            await jobs.refine(submission(), NPY)
            order.append("request")

        async def job():
            id = (await jobs.submit(submission())).record.id
            await ended(jobs, id)
            order.append("job")

        busy = asyncio.create_task(request())
        await asyncio.gather(job(), *(request() for _ in range(12)), busy)

    serve(scenario)
    assert 1 <= order.index("job") < 10


def test_the_same_key_gives_the_same_job(serve, submission, tmp_path):
    async def scenario(jobs):
        one, *others = await asyncio.gather(
            *(jobs.submit(submission(idempotency_key="frame-17")) for _ in range(3)), return_exceptions=True
        )
        assert all(isinstance(other, IdempotencyInFlight) for other in others)
        again = await jobs.submit(submission(idempotency_key="frame-17"))
        assert again.replayed
        assert again.record.id == one.record.id
        with pytest.raises(IdempotencyMismatch):
            await jobs.submit(submission(SLOW, idempotency_key="frame-17"))
        other = await jobs.submit(submission(owner="other", idempotency_key="frame-17"))
        assert other.record.id != one.record.id
        for accepted in (one, other):
            await ended(jobs, accepted.record.id)
        assert len(files_in(tmp_path / "data")) == 2

    serve(scenario)


def test_what_is_refused_leaves_nothing(serve, submission, scene, tmp_path):
    async def scenario(jobs):
        with pytest.raises(DamagedFile, match="left"):
            await jobs.submit(submission(files=scene.files | {"left": scene.files["left"][:20]}))
        held = await jobs.submit(submission(ENDLESS))
        with pytest.raises(QuotaExceeded) as refusal:
            await jobs.submit(submission())
        assert refusal.value.retry_after >= 1
        await jobs.purge(held.record.id, "local")
        with pytest.raises(JobNotFound):
            await jobs.get(held.record.id, None)
        assert files_in(tmp_path / "data") == []

    serve(scenario, max_jobs_per_key=1)


def test_no_job_of_another_key_is_seen(serve, submission):
    async def scenario(jobs):
        id = (await jobs.submit(submission(owner="mine"))).record.id
        for call in (jobs.get, jobs.cancel, jobs.purge, jobs.result):
            with pytest.raises(JobNotFound):
                await call(id, "yours")
        with pytest.raises(JobNotFinished):
            await jobs.result(id, "mine")

    serve(scenario)


def test_an_input_that_cannot_be_used_fails_its_job_and_says_why(serve, submission, scene, as_npy):
    async def scenario(jobs):
        files = scene.files | {"right": as_npy(scene.right[1:])}
        record = await ended(jobs, (await jobs.submit(submission(files=files))).record.id)
        assert record.error["slug"] == "shape-mismatch"
        with pytest.raises(JobFailed, match="64 x 47"):
            await jobs.result(record.id, None)

    serve(scenario)


def test_an_ending_server_answers_who_waits_and_refuses_what_comes(submission, tmp_path):
    async def scenario():
        async with service(tmp_path) as jobs:
            record = (await jobs.submit(submission(ENDLESS))).record
            record = await until(jobs, record.id, JobState.RUNNING)
            watching = asyncio.create_task(jobs.changed(record.id, None, record.version, 600))
            await asyncio.sleep(0)
        await asyncio.wait([watching], timeout=10)
        assert watching.done()
        assert watching.exception() is None or isinstance(watching.exception(), NotReady)
        with pytest.raises(NotReady):
            await jobs.submit(submission())

    asyncio.run(scenario())


def test_a_data_folder_has_one_server(serve, tmp_path):
    async def scenario(jobs):
        with pytest.raises(ConfigurationError, match="in use by another server"):
            async with service(tmp_path / "data"):
                pass

    serve(scenario)


def test_a_data_folder_that_cannot_be_used_is_named(tmp_path):
    (tmp_path / "file").write_text("")

    async def scenario():
        async with service(tmp_path / "file" / "data"):
            pass

    with pytest.raises(ConfigurationError, match=r"data folder .*file/data cannot be used: .*data_dir"):
        asyncio.run(scenario())


def fill(file):
    with suppress(OSError), file.open("wb", buffering=0) as stream:
        while stream.write(bytes(4096)):
            pass


def test_a_result_that_does_not_fit_the_disk_comes_once_there_is_room(
    serve, submission, small_disk, monkeypatch, caplog
):
    monkeypatch.setattr("stereomend.jobs.runner.DISK_FULL_PAUSE_S", 0.5)
    ballast = small_disk / "ballast"

    async def scenario(jobs):
        id = (await jobs.submit(submission(SLOW))).record.id
        await until(jobs, id, JobState.RUNNING)
        fill(ballast)
        with pytest.raises(DiskFull):
            await jobs.submit(submission())
        while "cannot be stored" not in caplog.text:
            await asyncio.sleep(0.1)
        assert not (await jobs.get(id, None)).state.final
        ballast.unlink()
        record = await ended(jobs, id)
        assert record.state is JobState.SUCCEEDED, record.error
        return await result_of(jobs, id)

    assert serve(scenario, folder=small_disk / "data") == map_of(submission(SLOW))
