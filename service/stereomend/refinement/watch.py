"""Who watches a refinement: told how far it is, and free to end it."""

from __future__ import annotations

from collections.abc import Callable

Watch = Callable[[str, int, int], None]
"""Told the stage that runs, and how many of how many steps of it are done (0 of 0: it has no steps).

Called in the thread that refines, before each stage and each warp; what it raises ends the refinement.
"""


def unwatched(stage: str, done: int, total: int) -> None:
    """Let the work go on."""


class Steps:
    """Counts the steps of one stage: to call it is to begin the next one."""

    def __init__(self, watch: Watch, stage: str, total: int) -> None:
        self._watch = watch
        self._stage = stage
        self._total = total
        self._done = 0

    def __call__(self) -> None:
        """Tell how many steps are done, and begin one more."""
        self._watch(self._stage, self._done, self._total)
        self._done += 1
