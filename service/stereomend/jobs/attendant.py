"""The thread of a worker that is never busy.

It tells the server every half second how far the task is, hears when the task is to be ended, and ends the
process when the server is gone.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from multiprocessing.connection import Connection, wait
from multiprocessing.process import parent_process
from threading import Lock, Thread
from typing import Any

from stereomend.errors import JobCancelled
from stereomend.jobs.orphans import die_with_parent

BEAT_S = 0.5
"""Between two beats while a task runs."""


class Attendant:
    """Stands between the thread that works and the server.

    Tasks are counted by both sides: the server rings with the number of the task that it no longer wants.
    """

    def __init__(self, connection: Connection, bell: Connection) -> None:
        self._connection = connection
        self._bell = bell
        self._sending = Lock()
        self._number = 0
        self._unwanted = 0
        self._progress: tuple[str, int, int] | None = None

    def start(self) -> None:
        """Begin to attend; call it first of all, for the server may be dead already."""
        die_with_parent()
        Thread(target=self._attend, name="attendant", daemon=True).start()

    def begin(self) -> None:
        """A task has come."""
        self._number += 1
        self._progress = ("decode", 0, 0)

    def watch(self, stage: str, done: int, total: int) -> None:
        """Take note of the progress (raises JobCancelled: nobody wants the result)."""
        self._progress = (stage, done, total)
        if self._unwanted == self._number:
            raise JobCancelled("the work was cancelled while it ran")

    def answer(self, head: Mapping[str, Any], body: bytes | None = None) -> None:
        """Send the last that is said about a task."""
        with self._sending:
            self._progress = None
            self._connection.send_bytes(json.dumps(head).encode())
            if body is not None:
                self._connection.send_bytes(body)

    def _attend(self) -> None:
        server = parent_process()
        sentinel = [] if server is None else [server.sentinel]
        while True:
            heard = wait([self._bell, *sentinel], BEAT_S)
            if sentinel and sentinel[0] in heard:
                break
            if self._bell in heard and not self._hear():
                break
            self._beat()
        # Not sys.exit: the main thread may be deep in native code.
        os._exit(1)

    def _hear(self) -> bool:
        try:
            self._unwanted = int(self._bell.recv_bytes())
        except (EOFError, OSError):
            return False
        return True

    def _beat(self) -> None:
        with self._sending:
            if self._progress is None:
                return
            try:
                self._connection.send_bytes(json.dumps({"beat": self._progress}).encode())
            except OSError:
                os._exit(1)
