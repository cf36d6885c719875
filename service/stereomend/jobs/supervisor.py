"""The supervisor: starts one process, again whenever it dies, and ends with it when told to.

It holds the listening socket, so that who connects while the process is replaced waits and is not refused.
Nothing but the standard library is used: what does little has little to die of.
"""

from __future__ import annotations

import logging
import os
import select
import signal
import socket
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

log = logging.getLogger(__name__)

READY = b"R"
"""What the process sends through its lifeline when it can answer."""

_FIRST_PAUSE_S = 0.1
_LONGEST_PAUSE_S = 5.0
_MOST_FALSE_STARTS = 5
_FORWARDED = (signal.SIGTERM, signal.SIGINT)


@dataclass(frozen=True)
class Supervised:
    """The process to keep running."""

    command: Sequence[str]
    """Absolute path and arguments; the descriptors of the socket and of the lifeline are added as numbers.

    The process ends when its lifeline is cut; see `orphans.end_with`.
    """
    environment: Mapping[str, str]
    listener: socket.socket
    on_ready: Callable[[], None]
    """Called when the process is ready for the first time."""
    patience_s: float
    """It is killed if it has not ended so long after it was told to."""


class Supervisor:
    """Runs in the main thread of a process that has no other children."""

    def __init__(self, supervised: Supervised) -> None:
        self._supervised = supervised
        self._signals: list[int] = []
        self._told_at: float | None = None
        self._ready_once = False

    def run(self) -> int:
        """Keep the process running until SIGTERM or SIGINT, which it is sent too, and return an exit code.

        A process that exits before it was ever ready is not started again: its exit code is returned.
        """
        false_starts = 0
        with self._listening_to_signals() as wakeup:
            while True:
                code, ready = self._one_life(wakeup)
                false_starts = 0 if ready else false_starts + 1
                if self._told_at is not None:
                    return 0 if -code in _FORWARDED else _exit_code(code)
                if not self._ready_once and (code >= 0 or false_starts >= _MOST_FALSE_STARTS):
                    return _exit_code(code)
                log.error("the server ended with exit code %d and is started again", code)
                if self._pause(wakeup, false_starts):
                    return 0

    def _one_life(self, wakeup: socket.socket) -> tuple[int, bool]:
        ours, theirs = socket.socketpair()
        ready = False
        with ours:
            with theirs:
                pid = self._spawn(theirs)
            while (code := _reaped(pid)) is None:
                self._pass_on(pid)
                if self._await(wakeup, None if ready else ours) and not ready:
                    ready = self._hear(ours)
        return code, ready

    def _spawn(self, lifeline: socket.socket) -> int:
        supervised = self._supervised
        inherited = [supervised.listener.fileno(), lifeline.fileno()]
        for descriptor in inherited:
            os.set_inheritable(descriptor, True)
        command = [*supervised.command, *map(str, inherited)]
        # In a group of its own, or Ctrl-C would reach it twice.
        return os.posix_spawn(command[0], command, dict(supervised.environment), setpgroup=0)

    def _await(self, wakeup: socket.socket, lifeline: socket.socket | None) -> bool:
        """Wait for a signal, or what comes through the lifeline; returns whether something has."""
        watched = [wakeup] if lifeline is None else [wakeup, lifeline]
        readable, _, _ = select.select(watched, [], [], self._patience_left())
        if wakeup in readable:
            wakeup.recv(4096)
        return lifeline in readable

    def _hear(self, lifeline: socket.socket) -> bool:
        if lifeline.recv(1) != READY:
            # It is ending: its death is told by SIGCHLD.
            time.sleep(0.01)
            return False
        if not self._ready_once:
            self._ready_once = True
            self._supervised.on_ready()
        return True

    def _pass_on(self, pid: int) -> None:
        while self._signals:
            os.kill(pid, self._signals.pop(0))
        if self._patience_left() == 0:
            os.kill(pid, signal.SIGKILL)

    def _patience_left(self) -> float | None:
        if self._told_at is None:
            return None
        return max(0.0, self._told_at + self._supervised.patience_s - time.monotonic())

    def _pause(self, wakeup: socket.socket, false_starts: int) -> bool:
        """Wait before the next start, longer after each false one; returns whether to end instead."""
        seconds = min(_LONGEST_PAUSE_S, _FIRST_PAUSE_S * 2**false_starts) if false_starts else 0.0
        until = time.monotonic() + seconds
        while self._told_at is None and (left := until - time.monotonic()) > 0:
            if select.select([wakeup], [], [], left)[0]:
                wakeup.recv(4096)
        return self._told_at is not None

    @contextmanager
    def _listening_to_signals(self) -> Generator[socket.socket, None, None]:
        wakeup, theirs = socket.socketpair()
        with wakeup, theirs:
            theirs.setblocking(False)
            signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
            signal.signal(signal.SIGCHLD, lambda *_: None)
            for number in _FORWARDED:
                signal.signal(number, self._on_signal)
            try:
                yield wakeup
            finally:
                signal.set_wakeup_fd(-1)

    def _on_signal(self, number: int, _: object) -> None:
        self._signals.append(number)
        if self._told_at is None:
            self._told_at = time.monotonic()


def _reaped(pid: int) -> int | None:
    """Reap all dead children, as process 1 of a container has to; the code of `pid`, None while it lives."""
    code = None
    while True:
        try:
            dead, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return code
        if dead == 0:
            return code
        if dead == pid:
            code = os.waitstatus_to_exitcode(status)


def _exit_code(code: int) -> int:
    return code if code >= 0 else 128 - code
