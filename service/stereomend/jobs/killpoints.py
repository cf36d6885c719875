"""Sudden death at named points, for trials of what survives it."""

from __future__ import annotations

import itertools
import os
import signal

_VARIABLE = "STEREOMEND_KILL_AT"
_passed = itertools.count(1)


def pass_killpoint(name: str) -> None:
    """Kill this process if `STEREOMEND_KILL_AT` is `name`, or at the n-th time if it is `name:n`."""
    wanted, _, times = os.environ.get(_VARIABLE, "").partition(":")
    if wanted == name and next(_passed) == int(times or 1):
        os.kill(os.getpid(), signal.SIGKILL)
