"""Who hears what happens to workers and jobs."""

from __future__ import annotations

from stereomend.errors import StereomendError
from stereomend.jobs.records import JobState
from stereomend.jobs.task import Answer, Task


class Listener:
    """Hears nothing; subclasses hear what they override, and must be quick: others wait."""

    def answered(self, task: Task, outcome: Answer | StereomendError) -> None:
        """A worker answered a task, or a task ended its worker."""

    def worker_ended(self) -> None:
        """A worker ended while the server ran; another takes its place."""

    def job_ended(self, state: JobState) -> None:
        """A durable job reached a final state; called in any thread."""
