"""`supervise.py COMMAND...`: a supervisor of any command, on a free port that it prints when it is ready."""

import ctypes
import os
import socket
import sys

from stereomend.jobs.logs import configure_logging
from stereomend.jobs.supervisor import Supervised, Supervisor

PR_SET_CHILD_SUBREAPER = 36

if __name__ == "__main__":
    configure_logging("text")
    # Orphans become its children, as if it were process 1.
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)
    listener = socket.create_server(("127.0.0.1", 0))

    def say():
        print(listener.getsockname()[1], flush=True)

    sys.exit(Supervisor(Supervised(sys.argv[1:], os.environ, listener, say, 10.0)).run())
