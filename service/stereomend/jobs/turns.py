"""Who waits for a worker, and whose turn is next."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import perf_counter

from stereomend.jobs.records import Progress
from stereomend.jobs.task import Answer, Task

DURABLE_EVERY = 4
"""So often at least, a turn is a durable job's while one waits."""

WAITS = Progress("queue")


@dataclass(eq=False)
class Ticket:
    """A task on its way through the pool; all of it belongs to the event loop."""

    task: Task
    answer: asyncio.Future[Answer]
    """Await it shielded: to cancel it is not to withdraw the ticket."""
    durable: bool = False
    request: bool = True
    """Somebody waits for it: when they leave, it is called off."""
    on_progress: Callable[[], None] | None = None
    progress: Progress = WAITS
    queued_at: float = field(default_factory=perf_counter)
    started_at: float = 0.0
    heard_at: float = 0.0
    """When the worker gave its last sign of life."""
    handed_out: int = 0

    def hear(self, progress: Progress) -> None:
        """Take note of a beat."""
        self.heard_at = perf_counter()
        if progress != self.progress:
            self.progress = progress
            if self.on_progress:
                self.on_progress()


class Turns:
    """Requests that somebody waits for come first, but every fourth turn is a durable job's."""

    def __init__(self) -> None:
        self._requests: deque[Ticket] = deque()
        self._jobs: deque[Ticket] = deque()
        self._since_job = 0

    def __len__(self) -> int:
        return len(self._requests) + len(self._jobs)

    def __contains__(self, ticket: Ticket) -> bool:
        return ticket in self._line(ticket)

    @property
    def requests(self) -> Sequence[Ticket]:
        """The tickets that somebody waits for, in their order."""
        return self._requests

    @property
    def wants_job(self) -> bool:
        """Whether the next turn would be a durable job's, if there were one: none is here."""
        return not self._jobs and (not self._requests or self._job_is_due)

    def add(self, ticket: Ticket, again: bool = False) -> None:
        """Let a ticket wait: at the end of its line, or at its head if it was handed out in vain."""
        if again:
            self._line(ticket).appendleft(ticket)
        else:
            self._line(ticket).append(ticket)

    def remove(self, ticket: Ticket) -> bool:
        """Take a ticket out of its line; whether it was there."""
        if ticket not in self:
            return False
        self._line(ticket).remove(ticket)
        return True

    def next(self) -> Ticket:
        """Take the ticket whose turn it is (raises IndexError: nobody waits)."""
        if self._jobs and (self._job_is_due or not self._requests):
            self._since_job = 0
            return self._jobs.popleft()
        self._since_job += 1
        return self._requests.popleft()

    @property
    def _job_is_due(self) -> bool:
        return self._since_job >= DURABLE_EVERY - 1

    def _line(self, ticket: Ticket) -> deque[Ticket]:
        return self._jobs if ticket.durable else self._requests
