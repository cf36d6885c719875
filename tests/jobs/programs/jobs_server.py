"""`jobs_server.py FOLDER LISTENER LIFELINE`: durable jobs behind a socket, and a point at which it dies.

Who connects and sends a line of parameters gets the id of a job: it is accepted. The files are FOLDER/*.npy.
A file FOLDER/doom holds the name of a point in the work: this process kills itself when it first gets there,
and the next one does not.
"""

import asyncio
import json
import os
import signal
import socket
import sys
from pathlib import Path

from stereomend.jobs.blobs import BlobStore
from stereomend.jobs.ledger import Ledger, rows
from stereomend.jobs.orphans import end_with
from stereomend.jobs.pool import WorkerPool
from stereomend.jobs.service import JobService, Submission
from stereomend.jobs.task import Files
from stereomend.refinement import parse_params
from stereomend.settings import load_settings

POINTS = {
    "rename of the inputs": (BlobStore, "put", "inputs/"),
    "insert": (rows, "insert_job", ""),
    "commit": (Ledger, "accept", ""),
    "claim": (Ledger, "claim", ""),
    "rename of the result": (BlobStore, "put", "results/"),
    "end in the ledger": (Ledger, "finish", ""),
}


def doom(folder):
    """Die after the call that FOLDER/doom names, once."""
    order = folder / "doom"
    if not order.exists():
        return
    place, name, prefix = POINTS[order.read_text()]
    call = getattr(place, name)

    def deadly(*args, **kwargs):
        done = call(*args, **kwargs)
        if (done is not None or name == "put") and any(str(arg).startswith(prefix) for arg in args):
            order.unlink()
            os.kill(os.getpid(), signal.SIGKILL)
        return done

    setattr(place, name, deadly)


async def serve(folder, listener, lifeline):
    settings = load_settings(backend="reference", data_dir=folder / "data", min_free_disk_mb=0, lease_s=5)
    pool = WorkerPool(settings)
    jobs = JobService(settings, pool)
    files = Files(**{name: (folder / f"{name}.npy").read_bytes() for name in ("left", "right", "disparity")})
    told = asyncio.Event()

    async def answer(reader, writer):
        params = json.loads(await reader.readline())
        accepted = await jobs.submit(Submission(files, parse_params(params), "local"))
        writer.write(accepted.record.id.encode())
        writer.close()

    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, told.set)
    await jobs.start()
    await pool.start()
    server = await asyncio.start_server(answer, sock=listener)
    lifeline.send(b"R")
    await told.wait()
    server.close()
    await jobs.stop(1.0)


def main():
    folder = Path(sys.argv[1])
    listener, lifeline = (socket.socket(fileno=int(number)) for number in sys.argv[2:])
    end_with(lifeline)
    doom(folder)
    asyncio.run(serve(folder, listener, lifeline))


if __name__ == "__main__":
    main()
