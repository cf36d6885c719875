"""The pool with real worker processes."""

import asyncio
import gc
import os
import signal
import weakref
from multiprocessing import active_children

import pytest

from stereomend.errors import (
    BackendUnavailable,
    InternalError,
    NotReady,
    QueueFull,
    ShapeMismatch,
    WorkerCrashed,
    WorkLimitExceeded,
)
from stereomend.jobs.pool import WorkerPool
from stereomend.jobs.task import Task, perform
from stereomend.refinement import parse_params, select_backend
from stereomend.settings import load_settings


def workers():
    return active_children()


async def begun(task):
    """Start a coroutine and let it get as far as it can without waiting for a worker."""
    started = asyncio.create_task(task)
    await asyncio.sleep(0.3)
    return started


def test_a_worker_answers_with_the_bytes_that_this_process_computes(supervise, quick):
    async def scenario(pool):
        return await pool.submit(quick)

    assert supervise(scenario).body == perform(quick, select_backend("reference"), 10**6).body


def test_of_an_answered_task_nothing_is_held(supervise, quick):
    async def scenario(pool):
        ticket = pool.enqueue(quick)
        await ticket.answer
        await asyncio.sleep(0)
        held = weakref.ref(ticket)
        del ticket
        gc.collect()
        return held()

    assert supervise(scenario) is None


def test_tasks_are_answered_in_the_order_they_came(supervise, quick):
    order = []

    async def scenario(pool):
        async def ask(number):
            answer = await pool.submit(quick)
            order.append(number)
            return answer

        return await asyncio.gather(*map(ask, range(5)))

    answers = supervise(scenario)
    assert order == [0, 1, 2, 3, 4]
    waited = [answer.timings["queue"] for answer in answers]
    assert waited == sorted(waited)
    assert all(answer.timings["queue"] < answer.timings["total"] for answer in answers)


def test_two_workers_work_at_once(supervise, quick, endless):
    async def scenario(pool):
        while pool.workers_up < 2:
            await asyncio.sleep(0.05)
        busy = await begun(pool.submit(endless))
        await pool.submit(quick)
        assert not busy.done()
        busy.cancel()

    supervise(scenario, workers=2)


def test_an_error_of_the_worker_is_raised_here(supervise, scene, as_npy):
    files = scene.files | {"right": as_npy(scene.right[1:])}
    task = Task(**files, params=parse_params(), media_type="image/png")

    async def scenario(pool):
        with pytest.raises(ShapeMismatch, match=r"64 x 47.*64 x 48"):
            await pool.submit(task)

    supervise(scenario)


def test_an_unexpected_error_is_ours_and_the_worker_goes_on(supervise, quick, capfd):
    odd = Task(**{**vars(quick), "params": quick.params.model_copy(update={"processing_scale": "half"})})

    async def scenario(pool):
        (before,) = workers()
        with pytest.raises(InternalError, match="log"):
            await pool.submit(odd)
        await pool.submit(quick)
        assert workers() == [before]

    supervise(scenario)
    assert "Traceback" in capfd.readouterr().err


def test_only_the_task_of_a_killed_worker_fails(supervise, quick, endless):
    async def scenario(pool):
        running = await begun(pool.submit(endless))
        waiting = asyncio.create_task(pool.submit(quick))
        (worker,) = workers()
        os.kill(worker.pid, signal.SIGKILL)
        with pytest.raises(WorkerCrashed):
            await running
        await waiting
        assert pool.ready

    supervise(scenario)


def test_a_worker_killed_while_idle_costs_no_task(supervise, quick):
    async def scenario(pool):
        for _ in range(3):
            (worker,) = workers()
            os.kill(worker.pid, signal.SIGKILL)
            worker.join()
            await pool.submit(quick)

    supervise(scenario)


def test_a_task_that_takes_too_long_ends_its_worker_and_no_other_task(supervise, quick, endless):
    async def scenario(pool):
        running = asyncio.create_task(pool.submit(endless))
        waiting = asyncio.create_task(pool.submit(quick))
        with pytest.raises(WorkLimitExceeded, match="1 s"):
            await running
        await waiting

    supervise(scenario, work_limit_s=1)


def test_a_full_queue_refuses_by_number(supervise, quick, endless):
    async def scenario(pool):
        held = [await begun(pool.submit(endless)) for _ in range(2)]
        with pytest.raises(QueueFull, match="2 requests") as refusal:
            await pool.submit(quick)
        assert refusal.value.retry_after >= 1
        for task in held:
            task.cancel()

    supervise(scenario, max_queued_jobs=2)


def test_a_full_queue_refuses_by_size(supervise, quick, endless):
    large = Task(bytes(2 << 20), b"", None, quick.params, quick.media_type)

    async def scenario(pool):
        running = await begun(pool.submit(endless))
        with pytest.raises(QueueFull, match="server holds"):
            await pool.submit(large)
        running.cancel()

    supervise(scenario, max_queued_mb=1)


def test_a_caller_that_gives_up_makes_room(supervise, quick, endless):
    async def scenario(pool):
        running = await begun(pool.submit(endless))
        waiting = await begun(pool.submit(endless))
        with pytest.raises(QueueFull):
            pool.check_room()
        waiting.cancel()
        await asyncio.wait([waiting])
        pool.check_room()
        running.cancel()

    supervise(scenario, max_queued_jobs=2)


def test_a_backend_that_does_not_work_fails_the_start():
    settings = load_settings().model_copy(update={"backend": "abacus"})

    async def start():
        pool = WorkerPool(settings)
        try:
            await pool.start()
        finally:
            await pool.stop()

    with pytest.raises(BackendUnavailable, match="abacus"):
        asyncio.run(start())


def test_a_stopped_pool_refuses_what_waits_and_leaves_no_process(quick, endless):
    async def scenario():
        pool = WorkerPool(load_settings(backend="reference"))
        await pool.start()
        running = await begun(pool.submit(endless))
        waiting = await begun(pool.submit(quick))
        await pool.stop(grace_s=0.1)
        for task in (running, waiting):
            with pytest.raises((NotReady, WorkerCrashed)):
                await task
        with pytest.raises(NotReady, match="shutting down"):
            await pool.submit(quick)
        assert not pool.ready

    asyncio.run(scenario())
    assert workers() == []
