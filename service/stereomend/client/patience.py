"""When to ask a server again, and when to give up."""

from __future__ import annotations

from stereomend.errors import IdempotencyInFlight, NotReady, QueueFull, StereomendError, WorkerCrashed

ATTEMPTS = 4
"""How often a refinement is asked for at most, while the server says that it may do later."""
LONGEST_WAIT_S = 30.0
"""A server that asks for more patience than this is not waited for."""
RESTART_S = 2.0
"""How long a server may be out of reach before it counts as not there."""
OUTAGE_S = 30.0
"""The same of a server that has a job of ours."""

_LATER = (QueueFull, NotReady, WorkerCrashed, IdempotencyInFlight)
_FIRST_PAUSE_S = 0.25
_LONGEST_PAUSE_S = 4.0


class Patience:
    """Counts the attempts of one request that is safe to repeat.

    Args:
        outage_s: how long to go on where nobody answers; 0 where it is not known that a server is there.
    """

    def __init__(self, outage_s: float = 0.0) -> None:
        self._outage_s = outage_s
        self._attempts = 0
        self._crashes = 0
        self._unanswered_s = 0.0

    def pause_after(self, error: StereomendError) -> float:
        """Seconds to wait before the next attempt (raises `error` itself where there should be none)."""
        if error.status is None and isinstance(error, NotReady):
            return self._pause_unanswered(error)
        self._attempts += 1
        self._crashes += isinstance(error, WorkerCrashed)
        if not self._lasts(error) or error.retry_after is None:
            raise error
        return error.retry_after

    def _lasts(self, error: StereomendError) -> bool:
        # What killed two workers will kill a third.
        soon = error.retry_after is not None and error.retry_after <= LONGEST_WAIT_S
        return isinstance(error, _LATER) and soon and self._attempts < ATTEMPTS and self._crashes <= 1

    def _pause_unanswered(self, error: StereomendError) -> float:
        pause = min(_LONGEST_PAUSE_S, max(_FIRST_PAUSE_S, self._unanswered_s))
        self._unanswered_s += pause
        if self._unanswered_s > self._outage_s:
            raise error
        return pause
