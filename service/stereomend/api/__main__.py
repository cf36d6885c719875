"""`python -m stereomend.api LISTENER LIFELINE`: the API process, as the supervisor starts it."""

# Workers do not import this module again, for its name is `__main__`.

from __future__ import annotations

import signal
import socket
import sys
from types import FrameType
from typing import NoReturn

from stereomend.jobs.orphans import end_with


def main() -> int:
    """Serve on an inherited socket until told to end, or until the supervisor is gone."""
    listener, lifeline = (socket.socket(fileno=int(number)) for number in sys.argv[1:])
    # First of all: the supervisor may be dead already.
    end_with(lifeline)
    # The imports take a second, in which it may be told to end.
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _end)
    from stereomend.api.process import serve_on

    return serve_on(listener, lifeline)


def _end(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit(0)


if __name__ == "__main__":
    sys.exit(main())
