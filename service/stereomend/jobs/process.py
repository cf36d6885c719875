"""One worker process as the server sees it."""

from __future__ import annotations

import asyncio
import multiprocessing
import signal
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import NamedTuple

from stereomend.errors import Unavailable, WorkerCrashed, WorkLimitExceeded
from stereomend.jobs.records import Progress
from stereomend.jobs.task import Answer, Task
from stereomend.jobs.worker import Hello, WorkerPlan, receive_answer, receive_hello, send_task, work

_SPAWN = multiprocessing.get_context("spawn")
# A Ctrl-C, or a service manager's SIGTERM to the whole group, is the server's to act on.
_LEFT_TO_THE_SERVER = (signal.SIGINT, signal.SIGTERM)


class _Ends(NamedTuple):
    """The server's ends of the pipes to a worker."""

    connection: Connection
    bell: Connection
    """Tells a worker that is busy to end a task; the server alone writes."""


class WorkerProcess:
    """A spawned worker and the pipes to it; `died` is done when the process is gone."""

    def __init__(self, process: SpawnProcess, ends: _Ends) -> None:
        self._process = process
        self._connection, self._bell = ends
        self._cause: Unavailable | None = None
        self.asked = 0
        """How many tasks it was given; who calls `ask` counts first, so that the task can be called off."""
        self.answered = 0
        loop = asyncio.get_running_loop()
        self.died: asyncio.Future[None] = loop.create_future()
        loop.add_reader(process.sentinel, self._on_death)

    @classmethod
    def start(cls, plan: WorkerPlan) -> WorkerProcess:
        """Spawn a worker without waiting until it is ready (raises OSError)."""
        return cls(*_spawn(plan))

    async def hello(self) -> Hello:
        """Wait until the worker is ready (raises its StereomendError; EOFError or OSError if it died)."""
        return await asyncio.to_thread(receive_hello, self._connection)

    def ask(self, task: Task, on_beat: Callable[[Progress], None]) -> Answer:
        """Send a task and wait for its answer; blocks, so call it in a thread, where `on_beat` is called too.

        Raises:
            BrokenPipeError: the worker was dead before it had the task.
            StereomendError: what the worker refused, or why it died.
        """
        send_task(self._connection, task)
        try:
            return receive_answer(self._connection, on_beat)
        except (EOFError, OSError) as error:
            raise self._cause_of_death() from error

    @property
    def exitcode(self) -> int | None:
        """As of `multiprocessing.Process`: negative for a signal, None while it lives."""
        return self._process.exitcode

    def call_off(self) -> None:
        """Tell the worker that nobody wants the answer to its task; it ends between two steps of the work."""
        # A dead one needs not be told.
        with suppress(OSError):
            self._bell.send_bytes(str(self.asked).encode())

    def expire(self, limit_s: float) -> None:
        """Kill the worker, for it took longer than `limit_s` seconds."""
        self._cause = WorkLimitExceeded(f"the refinement took longer than the {limit_s:g} s that it may take")
        self.kill()

    def give_up(self, silent_s: float) -> None:
        """Kill the worker, for nothing was heard of it for `silent_s` seconds."""
        self._cause = crashed(f"the worker process was silent for {silent_s:g} s; another replaces it")
        self.kill()

    def kill(self) -> None:
        """End the process at once; a worker has no state to lose."""
        self._process.kill()

    async def dispose(self) -> None:
        """Reap the process; call it when it has died and nobody asks it any more."""
        await asyncio.to_thread(self._process.join)
        self._connection.close()
        self._bell.close()

    def _on_death(self) -> None:
        asyncio.get_running_loop().remove_reader(self._process.sentinel)
        self.died.set_result(None)

    def _cause_of_death(self) -> Unavailable:
        return self._cause or crashed(
            "the worker process died while it worked on this request; another replaces it"
        )


def crashed(detail: str) -> WorkerCrashed:
    """Say that a worker died, and when to try again: a new one takes about a second to start."""
    error = WorkerCrashed(detail)
    error.retry_after = 1
    return error


def _spawn(plan: WorkerPlan) -> tuple[SpawnProcess, _Ends]:
    ours, theirs = _SPAWN.Pipe()
    hears, bell = _SPAWN.Pipe(duplex=False)
    process = _SPAWN.Process(target=work, args=(theirs, hears, plan), name="stereomend-worker", daemon=True)
    # Its own start would unblock them again.
    resource_tracker.ensure_running()
    # The child inherits the blocked signals before it runs any Python, so it never prints a traceback.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _LEFT_TO_THE_SERVER)
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    # Ours alone must remain, or the death of the worker would not end a read.
    theirs.close()
    hears.close()
    return process, _Ends(ours, bell)
