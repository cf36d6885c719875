"""Waiting for a change."""

import asyncio
import time

from stereomend.jobs.changes import rung


def test_an_event_ends_the_wait_and_so_does_time():
    async def scenario():
        event = asyncio.Event()
        began = time.monotonic()
        await rung(event, 0.2)
        assert time.monotonic() - began >= 0.19
        waiting = asyncio.create_task(rung(event, 60))
        await asyncio.sleep(0)
        event.set()
        await asyncio.wait_for(waiting, 10)

    asyncio.run(scenario())


def test_who_is_cancelled_as_the_event_comes_is_cancelled():
    async def scenario():
        event = asyncio.Event()
        waiting = asyncio.create_task(rung(event, 60))
        await asyncio.sleep(0)
        event.set()
        waiting.cancel()
        await asyncio.wait([waiting], timeout=10)
        assert waiting.cancelled()

    asyncio.run(scenario())
