"""Jobs through the SDK against real servers: one suite for both clients."""

import asyncio
import os
import signal
import threading

import httpx
import numpy as np
import pytest

from stereomend import AsyncClient, Client, refine
from stereomend.client.patience import Patience
from stereomend.errors import (
    IdempotencyInFlight,
    IdempotencyMismatch,
    InvalidParameter,
    JobCancelled,
    JobFailed,
    JobFinished,
    JobNotFinished,
    JobNotFound,
    NotReady,
    QueueFull,
    WorkerCrashed,
)

QUICK = {"gdr": {"warps": 1, "levels": 1}}
ENDLESS = {"gdr": {"warps": 1000, "iterations": 1000, "levels": 1}, "processing_scale": 1.0}


class Awaited:
    """What is awaited, with the interface of what waits."""

    def __init__(self, runner, inner):
        self.runner, self.inner = runner, inner

    def __getattr__(self, name):
        value = getattr(self.inner, name)
        return (lambda *args, **kwargs: self.finish(value(*args, **kwargs))) if callable(value) else value

    def finish(self, begun):
        if hasattr(begun, "__aiter__"):
            return self.each(begun)
        return self.wrapped(self.runner.run(self.outcome(begun)))

    async def outcome(self, begun):
        return await begun

    def each(self, generator):
        try:
            while (item := self.runner.run(self.outcome(anext(generator, None)))) is not None:
                yield self.wrapped(item)
        finally:
            self.runner.run(generator.aclose())

    def wrapped(self, value):
        return Awaited(self.runner, value) if hasattr(value, "refresh") else value


@pytest.fixture(params=["sync", "async"])
def connect(request):
    """Make a client of either kind: `connect(url)`."""
    with asyncio.Runner() as runner:
        clients = []

        def start(url, **options):
            client = Client(url, **options)
            if request.param == "async":
                client = Awaited(runner, AsyncClient(url, **options))
            clients.append(client)
            return client

        yield start
        for client in clients:
            client.close()


@pytest.fixture
def client(server, connect):
    return connect(server.url)


@pytest.fixture
def submit(scene):
    def send(client, **options):
        return client.submit(scene.left, scene.right, scene.disparity, **QUICK | options)

    return send


def test_a_job_gives_what_this_process_computes(client, submit, scene, stages):
    job = submit(client)
    assert len(job.id) == 32
    job.wait(timeout=60)
    assert job.state == "succeeded"
    assert job.status.error is None
    result, local = (
        job.result(),
        refine(scene.left, scene.right, scene.disparity, backend="reference", **QUICK),
    )
    for name in ("disparity", "confidence", "provenance", "input_confidence"):
        np.testing.assert_array_equal(getattr(result, name), getattr(local, name))
    assert result.quality == local.quality
    assert list(result.timings) == stages
    assert result.timings["total"] > 0


def test_another_process_can_pick_up_a_job_by_its_id(client, submit):
    job = submit(client)
    other = client.job(job.id)
    assert other.wait(timeout=60).state == "succeeded"
    assert job.refresh().state == "succeeded"
    with pytest.raises(JobNotFound):
        client.job("0" * 32)


def test_events_tell_of_a_job_until_it_has_ended(client, submit):
    job = submit(client)
    told = list(job.events())
    versions = [status.version for status in told]
    assert versions == sorted(set(versions))
    assert [status.ended for status in told] == [False] * (len(told) - 1) + [True]
    assert told[-1].state == job.state == "succeeded"
    assert [status.state for status in job.events()] == ["succeeded"]


def test_waiting_ends_where_the_client_says(client, submit):
    job = submit(client, **ENDLESS)
    with pytest.raises(JobNotFinished, match=job.id):
        job.wait(timeout=1.2)
    with pytest.raises(JobNotFinished):
        job.result()
    job.cancel()
    assert job.wait(timeout=30).state == "cancelled"
    with pytest.raises(JobCancelled):
        job.result()


def test_progress_is_told_while_a_job_runs(client, submit):
    job = submit(client, **ENDLESS)
    told = job.events()
    while (status := next(told)).phase != "gdr" or not status.steps[1]:
        pass
    assert 0 <= status.steps[0] <= status.steps[1]
    assert status.state == "running"
    told.close()
    job.delete()


def test_a_failed_job_says_why(client, scene):
    job = client.submit(scene.left, scene.right[1:], scene.disparity, **QUICK)
    assert job.wait(timeout=60).state == "failed"
    assert "64 x 47" in job.status.error
    with pytest.raises(JobFailed, match="64 x 47"):
        job.result()
    with pytest.raises(JobFinished):
        job.cancel()


def test_a_deleted_job_is_gone_and_may_be_deleted_again(client, submit):
    job = submit(client)
    job.delete()
    job.delete()
    for ask in (job.refresh, job.result, job.cancel, lambda: list(job.events())):
        with pytest.raises(JobNotFound):
            ask()


def test_a_key_makes_of_two_submissions_one_job(client, submit, request):
    key = request.node.name
    first = submit(client, idempotency_key=key)
    assert submit(client, idempotency_key=key).id == first.id
    assert submit(client).id != submit(client).id
    with pytest.raises(IdempotencyMismatch):
        submit(client, idempotency_key=key, preset="paper")


def test_what_is_asked_of_a_job_reaches_it(client, submit):
    job = submit(client, priority=9, deadline_s=1000, keep_inputs=True)
    assert job.status.document["priority"] == 9
    assert job.status.document["keep_inputs"] is True
    assert job.status.document["deadline"] > job.status.document["created_at"]
    with pytest.raises(InvalidParameter, match="priority"):
        submit(client, priority=1e9)
    with pytest.raises(InvalidParameter, match="outputs"):
        submit(client, outputs=["confidence"])


def test_all_jobs_are_listed_newest_first(serving, connect, submit):
    with serving() as server:
        client = connect(server.url)
        sent = [submit(client).id for _ in range(3)]
        client.job(sent[-1]).wait(timeout=60)
        assert [job.id for job in client.jobs()] == sent[::-1]
        assert {job.id for job in client.jobs(state="succeeded")} == set(sent)
        assert list(client.jobs(state="failed")) == []


def test_a_list_longer_than_a_page_is_whole(serving, connect, scene):
    with serving() as server:
        client = connect(server.url)
        small = (scene.left[:8, :12], scene.right[:8, :12], np.ones((8, 12), np.float32))
        sent = {client.submit(*small, stages=["ldr"]).id for _ in range(52)}
        found = [job.id for job in client.jobs()]
        assert set(found) == sent
        assert len(found) == 52


def test_a_job_outlives_a_restart_of_the_server(serving, connect, submit, eventually):
    with serving() as server:
        client = connect(server.url)
        job = submit(client, gdr={"warps": 12, "iterations": 1000, "levels": 1}, processing_scale=1.0)
        eventually(lambda: job.refresh().state == "running")
        os.kill(server.api, signal.SIGKILL)
        told = [status.state for status in job.events()]
        assert told[-1] == job.state == "succeeded"
        assert job.status.document["attempt"] == 2
        assert job.result().disparity.shape == (48, 64)


class Lossy(httpx.BaseTransport):
    """Loses the first answer of every kind of request, after the server has acted on it."""

    def __init__(self):
        self.inner = httpx.HTTPTransport()
        self.lost = set()
        self.keys = []

    def handle_request(self, request):
        response = self.inner.handle_request(request)
        self.keys.append(request.headers.get("Idempotency-Key"))
        kind = request.method, request.url.path
        if kind in self.lost:
            return response
        self.lost.add(kind)
        response.close()
        raise httpx.ReadError("the connection was lost")

    def close(self):
        self.inner.close()


def test_a_request_whose_answer_is_lost_is_sent_again_and_does_no_harm(serving, submit, monkeypatch):
    with serving() as server:
        lossy, client = Lossy(), Client(server.url)
        monkeypatch.setattr(client._link._http, "_transport", lossy)
        job = submit(client)
        assert lossy.keys[0] == lossy.keys[1] is not None
        assert job.wait(timeout=60).result().disparity.shape == (48, 64)
        assert len(list(client.jobs())) == 1
        job.delete()
        assert list(client.jobs()) == []
        client.close()


def test_a_refinement_whose_answer_is_lost_is_not_sent_again(server, scene, monkeypatch):
    lossy, client = Lossy(), Client(server.url)
    monkeypatch.setattr(client._link._http, "_transport", lossy)
    with pytest.raises(NotReady, match="lost"):
        client.refine(scene.left, scene.right, scene.disparity, **QUICK)
    assert len(lossy.keys) == 1
    client.close()


def test_a_full_queue_is_waited_for(serving, connect, submit):
    with serving(max_jobs_per_key=1) as server:
        client = connect(server.url)
        first = submit(client, **ENDLESS)
        timer = threading.Timer(1.0, lambda: httpx.delete(f"{server.url}/v1/jobs/{first.id}"))
        timer.start()
        assert submit(client).wait(timeout=60).state == "succeeded"
        timer.join()


def failed(kind, status, retry_after):
    error = kind("why")
    error.status, error.retry_after = status, retry_after
    return error


@pytest.mark.parametrize(
    ("error", "pauses"),
    [
        (failed(QueueFull, 429, 2), [2, 2, 2]),
        (failed(IdempotencyInFlight, 409, 1), [1, 1, 1]),
        (failed(WorkerCrashed, 503, 1), [1]),
        (failed(QueueFull, 429, 31), []),
        (failed(QueueFull, 429, None), []),
        (failed(JobNotFinished, 409, 1), []),
        (failed(NotReady, None, None), [0.25, 0.25, 0.5, 1.0]),
    ],
    ids=lambda value: type(value).__name__,
)
def test_patience_lasts_as_long_as_it_may_help(error, pauses):
    patience, taken = Patience(outage_s=2.0), []
    for _ in pauses:
        taken.append(patience.pause_after(error))
    assert taken == pauses
    with pytest.raises(type(error)):
        patience.pause_after(error)


def test_a_server_that_was_never_there_is_not_waited_for_long(connect, submit):
    with pytest.raises(NotReady, match="cannot be reached"):
        submit(connect("http://127.0.0.1:9"))


def test_the_sdk_says_what_it_has(client, submit):
    job = submit(client)
    assert job.id in repr(getattr(job, "inner", job))
