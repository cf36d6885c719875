"""The pool: keeps the workers running and hands them tasks, first come, first served among equals.

All of its state lives on the event loop, so there are no locks; only pipes are read and written in threads.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from time import perf_counter
from typing import NamedTuple, TypeVar

from stereomend.errors import (
    ConfigurationError,
    DeviceFault,
    InternalError,
    JobCancelled,
    NotReady,
    QueueFull,
    StereomendError,
)
from stereomend.jobs.listener import Listener
from stereomend.jobs.process import WorkerProcess, crashed
from stereomend.jobs.records import Progress
from stereomend.jobs.task import Answer, Task
from stereomend.jobs.turns import Ticket, Turns
from stereomend.jobs.worker import Hello, WorkerPlan
from stereomend.settings import Settings

log = logging.getLogger(__name__)

T = TypeVar("T")

LONGEST_PAUSE_S = 5.0
"""Between two attempts to start a worker that keeps dying."""
_QUARTERS = 4
"""Of a lease, over which nothing is heard of a worker that is given up."""
GRACE_S = 5.0
"""What `stop` leaves to the tasks that run."""


class Depth(NamedTuple):
    """How many requests wait and run, and how long the oldest has waited [s]."""

    waiting: int
    running: int
    oldest_s: float


class WorkerPool:
    """Runs `settings.workers` workers from `start` to `stop`, both on the loop that submits."""

    def __init__(self, settings: Settings, listeners: Sequence[Listener] = ()) -> None:
        self._settings = settings
        self._listeners = listeners
        self._plan = WorkerPlan.of(settings)
        self._up: list[WorkerProcess] = []
        self._idle: deque[WorkerProcess] = deque()
        self._waiting = Turns()
        self._running: dict[asyncio.Task[None], WorkerProcess] = {}
        self._at_work: dict[Ticket, WorkerProcess] = {}
        self._keepers: list[asyncio.Task[None]] = []
        self._threads = ThreadPoolExecutor(settings.workers, "worker-pipe")
        self._held: set[Ticket] = set()
        self._pace_s = 1.0
        self._hello: Hello | None = None
        self._problem: str | None = "the first worker is starting"
        self._stopping = False
        self.welcomes_job = asyncio.Event()
        """Set while a durable job would be handed out next, if there were one."""

    @property
    def ready(self) -> bool:
        """Whether a worker is up that can take tasks."""
        return bool(self._up) and not self._stopping

    @property
    def workers_up(self) -> int:
        """The number of workers that are ready or at work."""
        return len(self._up)

    @property
    def depth(self) -> Depth:
        """What waits and runs now for somebody who waits for it; the ledger knows of jobs."""
        waiting = self._waiting.requests
        running = sum(ticket.request and not ticket.durable for ticket in self._at_work)
        return Depth(len(waiting), running, perf_counter() - waiting[0].queued_at if waiting else 0.0)

    @property
    def pace_s(self) -> float:
        """What one task takes a worker, by the last few [s]."""
        return self._pace_s

    def hello(self) -> Hello:
        """What computes here, and why (raises NotReady while no worker is up)."""
        if not self.ready or self._hello is None:
            raise self._not_ready()
        return self._hello

    async def start(self) -> None:
        """Start the workers; returns when the first is ready or has died.

        Raises:
            ConfigurationError: the backend that was asked for does not work here.
        """
        first: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._keepers = [asyncio.create_task(self._keep(first)) for _ in range(self._settings.workers)]
        await first

    async def submit(self, task: Task) -> Answer:
        """Wait for a worker and its answer; work whose caller is cancelled is not begun, or ended soon.

        Raises:
            QueueFull: too many tasks or bytes are held; `retry_after` says when to come again.
            NotReady: no worker can be started, or the server is ending.
            WorkerCrashed, WorkLimitExceeded: this task ended its worker.
            InputError: the worker refused the task.
        """
        ticket = self.enqueue(task)
        try:
            return await ticket.answer
        finally:
            self.call_off(ticket)

    def enqueue(self, task: Task) -> Ticket:
        """Let a task wait for a worker; `Ticket.answer` raises as `submit` (raises as `check_room`)."""
        self.check_room(task.size)
        ticket = _ticket(task)
        self._held.add(ticket)
        ticket.answer.add_done_callback(lambda _: self._held.discard(ticket))
        self._waiting.add(ticket)
        self._hand_out()
        return ticket

    def enqueue_job(self, task: Task) -> Ticket:
        """Let the task of a durable job wait, however many do; its room was found when it was accepted."""
        ticket = _ticket(task, durable=True)
        if self._stopping:
            _settle(ticket.answer, self._not_ready())
            return ticket
        self._waiting.add(ticket)
        self._hand_out()
        return ticket

    def withdraw(self, ticket: Ticket) -> bool:
        """Take back a ticket that still waits; False if a worker has it or had it."""
        withdrawn = self._waiting.remove(ticket)
        self._held.discard(ticket)
        self._note_welcome()
        return withdrawn

    def call_off(self, ticket: Ticket) -> None:
        """End a ticket: its answer, where there is none yet, will be JobCancelled."""
        if self.withdraw(ticket):
            _settle(ticket.answer, JobCancelled("the work was cancelled before it began"))
        elif worker := self._at_work.get(ticket):
            worker.call_off()

    def check_room(self, size: int = 0) -> None:
        """Refuse now what would be refused once its body is read; `size` in bytes (raises as `submit`)."""
        if self._stopping or (self._problem and not self._up):
            raise self._not_ready()
        held, most = sum(ticket.task.size for ticket in self._held), self._settings.max_queued_mb << 20
        if len(self._held) >= self._settings.max_queued_jobs or (self._held and held + size > most):
            raise self._queue_full(held >> 20)

    async def stop(self, grace_s: float = GRACE_S) -> None:
        """Refuse what waits, let what runs finish for `grace_s` seconds, then end all workers."""
        self._stopping = True
        self._refuse_waiting()
        self._note_welcome()
        if self._running:
            await asyncio.wait(self._running, timeout=grace_s)
        for keeper in self._keepers:
            keeper.cancel()
        await asyncio.gather(*self._keepers, return_exceptions=True)
        self._threads.shutdown()

    async def _keep(self, first: asyncio.Future[None]) -> None:
        failures = 0
        while True:
            answered = await self._one_life(first)
            failures = 0 if answered else failures + 1
            await asyncio.sleep(min(LONGEST_PAUSE_S, 0.1 * 2**failures) if failures else 0)

    async def _one_life(self, first: asyncio.Future[None]) -> int:
        try:
            worker = WorkerProcess.start(self._plan)
        except OSError as error:
            self._cannot_start(f"no worker can be started: {error}")
            _settle(first, None)
            return 0
        try:
            await self._live(worker, first)
        finally:
            await self._bury(worker)
        return worker.answered

    async def _live(self, worker: WorkerProcess, first: asyncio.Future[None]) -> None:
        try:
            hello = await worker.hello()
        except ConfigurationError as error:
            # At the start its caller says it.
            self._cannot_start(str(error), said=not first.done())
            _settle(first, error)
        except Exception as error:
            self._cannot_start(f"a worker died while it started ({error!r})")
        else:
            self._welcome(worker, hello)
        _settle(first, None)
        # To await `died` itself would cancel it when this is cancelled.
        await asyncio.wait([worker.died])

    def _welcome(self, worker: WorkerProcess, hello: Hello) -> None:
        log.info("a worker is ready: %s (%s)", hello.backend, hello.reason)
        self._hello, self._problem = hello, None
        self._up.append(worker)
        self._idle.append(worker)
        self._hand_out()

    def _cannot_start(self, problem: str, said: bool = False) -> None:
        if not said:
            log.error("%s", problem)
        if not self._up:
            self._problem = problem
            self._refuse_waiting()

    async def _bury(self, worker: WorkerProcess) -> None:
        worker.kill()
        if worker in self._up:
            self._up.remove(worker)
        if worker in self._idle:
            self._idle.remove(worker)
        self._note_welcome()
        await asyncio.wait([worker.died, *(task for task, its in self._running.items() if its is worker)])
        await worker.dispose()
        if not self._stopping:
            for listener in self._listeners:
                listener.worker_ended()
        level = logging.INFO if self._stopping else logging.WARNING
        log.log(level, "a worker ended with exit code %s", worker.exitcode)

    def _hand_out(self) -> None:
        while self._waiting and self._idle:
            ticket = self._waiting.next()
            worker = self._idle.popleft()
            ticket.handed_out += 1
            worker.asked += 1
            self._at_work[ticket] = worker
            running = asyncio.create_task(self._run(worker, ticket))
            self._running[running] = worker
            running.add_done_callback(self._running.pop)
        self._note_welcome()

    def _note_welcome(self) -> None:
        if self.ready and self._waiting.wants_job and (self._idle or self._waiting):
            self.welcomes_job.set()
        else:
            self.welcomes_job.clear()

    async def _run(self, worker: WorkerProcess, ticket: Ticket) -> None:
        loop, limit_s = asyncio.get_running_loop(), self._settings.work_limit_s
        ticket.started_at = ticket.heard_at = perf_counter()
        alarm = loop.call_later(limit_s, worker.expire, limit_s)
        listening = asyncio.create_task(self._listen(worker, ticket))

        def on_beat(progress: Progress) -> None:
            loop.call_soon_threadsafe(ticket.hear, progress)

        try:
            answer = await loop.run_in_executor(self._threads, worker.ask, ticket.task, on_beat)
        except BrokenPipeError:
            self._hand_out_again(ticket)
        except StereomendError as error:
            self._done(worker, ticket, error)
        except Exception:
            log.exception("request %s failed", ticket.task.request_id)
            worker.kill()
            _settle(ticket.answer, InternalError("the worker's answer could not be read"))
        else:
            self._done(worker, ticket, _timed(answer, ticket))
        finally:
            alarm.cancel()
            listening.cancel()
            self._at_work.pop(ticket, None)

    async def _listen(self, worker: WorkerProcess, ticket: Ticket) -> None:
        """Give a worker up that was silent for so long that its lease is over.

        In quarters: this process may stand still itself, and wakes up before it hears what came meanwhile.
        """
        lease_s = self._settings.lease_s
        heard_at, left = ticket.heard_at, _QUARTERS
        while left:
            await asyncio.sleep(lease_s / _QUARTERS)
            heard_at, left = ticket.heard_at, left - 1 if ticket.heard_at == heard_at else _QUARTERS
        worker.give_up(lease_s)

    def _done(self, worker: WorkerProcess, ticket: Ticket, outcome: Answer | StereomendError) -> None:
        for listener in self._listeners:
            listener.answered(ticket.task, outcome)
        _settle(ticket.answer, outcome)
        if isinstance(outcome, Answer):
            self._pace_s += 0.2 * (perf_counter() - ticket.started_at - self._pace_s)
            worker.answered += 1
        if isinstance(outcome, DeviceFault) and worker in self._up:
            # It ends by itself; what waits is left to the next.
            self._up.remove(worker)
        if worker in self._up and not worker.died.done():
            self._idle.append(worker)
            self._hand_out()

    def _hand_out_again(self, ticket: Ticket) -> None:
        # The worker was dead before it had the task, which is no fault of the task's.
        if ticket.handed_out > 1:
            _settle(ticket.answer, crashed("two workers died before they had this request"))
        else:
            self._waiting.add(ticket, again=True)
            self._hand_out()

    def _refuse_waiting(self) -> None:
        while self._waiting:
            _settle(self._waiting.next().answer, self._not_ready())

    def _not_ready(self) -> NotReady:
        why = (
            "the server is shutting down"
            if self._stopping
            else self._problem or "a worker is being restarted"
        )
        error = NotReady(f"no worker is up: {why}")
        error.retry_after = 1 if self._stopping else LONGEST_PAUSE_S
        return error

    def _queue_full(self, held_mb: int) -> QueueFull:
        settings = self._settings
        error = QueueFull(
            f"{len(self._held)} requests with {held_mb} MiB wait or run; "
            f"the server holds {settings.max_queued_jobs} with {settings.max_queued_mb} MiB"
        )
        error.retry_after = math.ceil(self._pace_s * len(self._held) / settings.workers)
        return error


def _ticket(task: Task, durable: bool = False) -> Ticket:
    ticket = Ticket(task, asyncio.get_running_loop().create_future(), durable)
    # Nobody may be left to hear that it failed, which asyncio would complain about.
    ticket.answer.add_done_callback(lambda answer: answer.cancelled() or answer.exception())
    return ticket


def _timed(answer: Answer, ticket: Ticket) -> Answer:
    seconds = {"queue": ticket.started_at - ticket.queued_at, "total": perf_counter() - ticket.queued_at}
    return replace(answer, timings=answer.timings | {name: 1e3 * value for name, value in seconds.items()})


def _settle(future: asyncio.Future[T], outcome: T | StereomendError) -> None:
    if future.done():
        return
    if isinstance(outcome, StereomendError):
        future.set_exception(outcome)
    else:
        future.set_result(outcome)
