"""When to ask a server again, and when to give up."""

from __future__ import annotations

from stereomend.errors import NotReady, QueueFull, StereomendError, WorkerCrashed

ATTEMPTS = 4
"""How often a refinement is asked for at most, while the server says that it may do later."""
LONGEST_WAIT_S = 30.0
"""A server that asks for more patience than this is not waited for."""


class Patience:
    """Counts the attempts of one refinement: to repeat one is safe, since it leaves nothing behind."""

    def __init__(self) -> None:
        self._attempts = 0
        self._crashes = 0

    def pause_after(self, error: StereomendError) -> float:
        """Seconds to wait before the next attempt (raises `error` itself where there should be none)."""
        self._attempts += 1
        self._crashes += isinstance(error, WorkerCrashed)
        if not self._lasts(error) or error.retry_after is None:
            raise error
        return error.retry_after

    def _lasts(self, error: StereomendError) -> bool:
        # Without a status nobody answered; and what killed two workers will kill a third.
        answered = error.status is not None and isinstance(error, QueueFull | NotReady | WorkerCrashed)
        soon = error.retry_after is not None and error.retry_after <= LONGEST_WAIT_S
        return answered and soon and self._attempts < ATTEMPTS and self._crashes <= 1
