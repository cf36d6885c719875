"""`python -m stereomend.api LISTENER LIFELINE`: the API process, as the supervisor starts it."""

# Workers do not import this module again, for its name is `__main__`.

from __future__ import annotations

import socket
import sys

from stereomend.jobs.orphans import end_with


def main() -> int:
    """Serve on an inherited socket until told to end, or until the supervisor is gone."""
    listener, lifeline = (socket.socket(fileno=int(number)) for number in sys.argv[1:])
    # First of all: the supervisor may be dead already.
    end_with(lifeline)
    from stereomend.api.process import serve_on

    return serve_on(listener, lifeline)


if __name__ == "__main__":
    sys.exit(main())
