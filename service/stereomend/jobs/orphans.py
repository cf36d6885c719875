"""Processes that end with their parent, however it ends."""

from __future__ import annotations

import ctypes
import os
import signal
import socket
from threading import Thread

_PR_SET_PDEATHSIG = 1  # of linux/prctl.h


def die_with_parent() -> None:
    """Have the kernel kill this process when its parent dies, even while it is stopped or hangs.

    A parent that is dead already is not noticed: whoever calls this also watches a descriptor whose other end
    the parent alone holds. It must be the thread that started this process that lives as long as the parent.
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def end_with(lifeline: socket.socket) -> None:
    """End this process at once when the other end of `lifeline` is closed, or was before this is called."""
    die_with_parent()
    Thread(target=_end_when_cut, args=(lifeline,), name="lifeline", daemon=True).start()


def _end_when_cut(lifeline: socket.socket) -> None:
    while lifeline.recv(64):
        pass
    # Not sys.exit: the main thread may wait for ever. The workers end with this process.
    os._exit(1)
