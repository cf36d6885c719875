"""Real servers and small inputs for the tests of jobs, API and SDK."""

import io
import os
import re
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from stereomend.api.server import server_process
from stereomend.phantom import break_disparity, make_phantom
from stereomend.settings import load_settings


@dataclass
class Served:
    """A server under test, and what the operating system tells about it."""

    url: str
    process: object
    log: Path

    @property
    def pid(self):
        """The supervisor."""
        return self.process.pid

    @property
    def api(self):
        """The API process; None while it is replaced."""
        return next((pid for pid in children(self.pid) if b"stereomend.api" in command(pid)), None)

    def workers(self):
        return [pid for pid in children(self.api) if b"spawn_main" in command(pid)]

    def cpu(self):
        """Seconds that the workers have computed, their own start included."""
        ticks = [sum(map(int, stat(pid)[11:13])) for pid in self.workers()]
        return sum(ticks) / os.sysconf("SC_CLK_TCK")

    def memory(self, line):
        """`VmRSS` (now) or `VmHWM` (highest) of the server and its workers [MiB]."""
        return sum(memory(pid, line) for pid in (self.pid, self.api, *self.workers()))


def children(parent):
    return [pid for pid in processes() if stat(pid)[1] == str(parent)]


def processes():
    return [int(folder.name) for folder in Path("/proc").iterdir() if folder.name.isdecimal()]


def stat(pid):
    text = read(f"/proc/{pid}/stat").decode()
    return text.rpartition(")")[2].split() or ["gone", ""]


def command(pid):
    return read(f"/proc/{pid}/cmdline")


def memory(pid, line):
    found = re.search(rf"{line}:\s*(\d+) kB", read(f"/proc/{pid}/status").decode())
    return int(found[1]) / 1024 if found else 0.0


def read(path):
    try:
        return Path(path).read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return b""


@contextmanager
def run_server(folder, **settings):
    log = folder / "server.log"
    chosen = {"port": 0, "backend": "reference", "data_dir": folder / "data"} | settings
    with log.open("w") as stream, server_process(load_settings(**chosen), stream) as server:
        yield Served(server.url, server.process, log)


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    """One server with default limits, for all tests that leave it as they found it."""
    with run_server(tmp_path_factory.mktemp("server")) as served:
        yield served


@pytest.fixture
def serving(tmp_path):
    """Start a server of one's own: `with serving(work_limit_s=1) as server`."""

    def start(**settings):
        return run_server(tmp_path, **settings)

    return start


@pytest.fixture
def stages():
    """What `Server-Timing` names, in its order."""
    return ["queue", "decode", "prepare", "initial", "ldr", "gdr", "finish", "encode", "total"]


@pytest.fixture
def eventually():
    """Wait until a condition holds, or fail."""

    def wait(condition, seconds=20.0):
        deadline = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < deadline, "it did not happen in time"
            time.sleep(0.02)

    return wait


@pytest.fixture
def alive():
    """Whether a process runs; a zombie does not."""
    return lambda pid: stat(pid)[0] not in ("gone", "Z")


@pytest.fixture(name="children")
def children_of():
    """The children of a process, zombies included."""
    return children


@pytest.fixture(scope="session")
def scene():
    """A small phantom and its broken disparity: `.left`, `.right`, `.disparity`."""
    phantom = make_phantom(7, 64, 48)
    return Scene(phantom.pair.left, phantom.pair.right, break_disparity(phantom, 7).values)


@dataclass
class Scene:
    left: np.ndarray
    right: np.ndarray
    disparity: np.ndarray

    @property
    def files(self):
        """Each array as the bytes of an NPY file."""
        return {name: npy(array) for name, array in vars(self).items()}


def npy(array, allow_pickle=False):
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=allow_pickle)
    return stream.getvalue()


@pytest.fixture(scope="session")
def as_npy():
    return npy
