"""One worker process as the server sees it."""

from __future__ import annotations

import asyncio
import multiprocessing
import signal
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess

from stereomend.errors import DeviceFault, Unavailable, WorkerCrashed, WorkLimitExceeded
from stereomend.jobs.task import Answer, Task
from stereomend.jobs.worker import Hello, WorkerPlan, receive_answer, receive_hello, send_task, work

_SPAWN = multiprocessing.get_context("spawn")
# A Ctrl-C, or a service manager's SIGTERM to the whole group, is the server's to act on.
_LEFT_TO_THE_SERVER = (signal.SIGINT, signal.SIGTERM)

RESTART_S = 1.0
"""What a new worker takes to start, about."""


class WorkerProcess:
    """A spawned worker and the pipe to it; `died` is done when the process is gone."""

    def __init__(self, process: SpawnProcess, connection: Connection) -> None:
        self._process = process
        self._connection = connection
        self._overdue_s: float | None = None
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

    def ask(self, task: Task) -> Answer:
        """Send a task and wait for its answer; blocks, so call it in a thread.

        Raises:
            BrokenPipeError: the worker was dead before it had the task.
            StereomendError: what the worker refused, or why it died.
        """
        send_task(self._connection, task)
        try:
            return receive_answer(self._connection)
        except DeviceFault as error:
            error.retry_after = RESTART_S
            raise
        except (EOFError, OSError) as error:
            raise self._cause_of_death() from error

    @property
    def exitcode(self) -> int | None:
        """As of `multiprocessing.Process`: negative for a signal, None while it lives."""
        return self._process.exitcode

    def expire(self, limit_s: float) -> None:
        """Kill the worker, for it took longer than `limit_s` seconds."""
        self._overdue_s = limit_s
        self.kill()

    def kill(self) -> None:
        """End the process at once; a worker has no state to lose."""
        self._process.kill()

    async def dispose(self) -> None:
        """Reap the process; call it when it has died and nobody asks it any more."""
        await asyncio.to_thread(self._process.join)
        self._connection.close()

    def _on_death(self) -> None:
        asyncio.get_running_loop().remove_reader(self._process.sentinel)
        self.died.set_result(None)

    def _cause_of_death(self) -> Unavailable:
        if self._overdue_s is not None:
            return WorkLimitExceeded(
                f"the refinement took longer than the {self._overdue_s:g} s that it may take"
            )
        return crashed("the worker process died while it worked on this request; another replaces it")


def crashed(detail: str) -> WorkerCrashed:
    """Say that a worker died, and when to try again."""
    error = WorkerCrashed(detail)
    error.retry_after = RESTART_S
    return error


def _spawn(plan: WorkerPlan) -> tuple[SpawnProcess, Connection]:
    ours, theirs = _SPAWN.Pipe()
    process = _SPAWN.Process(target=work, args=(theirs, plan), name="stereomend-worker", daemon=True)
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
    return process, ours
