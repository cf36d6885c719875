"""A service that is killed again and again, and what a service manager does then: start it once more."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Lock, Thread
from uuid import uuid4

import httpx

from trials.processes import alive, descendants, is_worker, named_in_environment

READY_S = 60.0
"""How long a service may take to answer, on a machine that others use too."""
ORPHAN_S = 30.0
"""How long a process may outlast the one that it belongs to: one that starts has to be up to notice."""
_PAUSE_S = 0.05


class Service:
    """`stereomend serve` on one port and one data folder, kept running until it is left."""

    def __init__(self, folder: Path, settings: Mapping[str, object], log: Path) -> None:
        self.folder = folder
        self.port = _free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self.starts = 0
        """How often the supervisor was started."""
        self._mark = f"STEREOMEND_TRIAL={uuid4().hex}"
        given = {"port": self.port, "data_dir": folder, **settings}
        self._environment = os.environ | {f"STEREOMEND_{name.upper()}": str(of) for name, of in given.items()}
        self._environment |= dict([self._mark.split("=")])
        self._log = log.open("ab")
        self._process: subprocess.Popen[bytes] | None = None
        self._changing = Lock()
        self._left = Event()
        self._manager = Thread(target=self._manage, daemon=True)

    @property
    def supervisor(self) -> int | None:
        """Its process, while there is one."""
        with self._changing:
            running = self._process is not None and self._process.poll() is None
            return self._process.pid if running and self._process else None

    @property
    def api(self) -> int | None:
        """The API process, while there is one."""
        found = [] if self.supervisor is None else descendants(self.supervisor)
        return next((pid for pid in found if not is_worker(pid)), None)

    def some_api(self) -> int:
        """The API process, once there is one (raises TimeoutError)."""
        until(lambda: self.api, "there is an API process")
        return self.api or self.some_api()

    @property
    def workers(self) -> list[int]:
        """The worker processes that there are."""
        return (
            [] if self.supervisor is None else [pid for pid in descendants(self.supervisor) if is_worker(pid)]
        )

    def all_processes(self) -> list[int]:
        """Every process that was ever started for this service and lives."""
        return [pid for pid in named_in_environment(self._mark) if alive(pid)]

    def orphans(self) -> list[int]:
        """Processes of this service that belong to no supervisor that lives."""
        ours = self.supervisor
        family = [] if ours is None else [ours, *descendants(ours)]
        return [pid for pid in self.all_processes() if pid not in family]

    def set(self, name: str, value: str | None) -> None:
        """Change a variable of the environment of all later starts."""
        with self._changing:
            self._environment.pop(name, None)
            if value is not None:
                self._environment[name] = value

    def ready(self) -> bool:
        """Whether a worker is up that takes work."""
        try:
            return httpx.get(f"{self.url}/readyz", timeout=5).status_code == 200
        except httpx.TransportError:
            return False

    def restart(self, number: int = signal.SIGKILL) -> None:
        """Send the supervisor a signal and wait until it has been started anew."""
        before = self.starts
        until(lambda: kill(self.supervisor, number), "there is a supervisor")
        until(lambda: self.starts > before, "the service starts again")

    def _manage(self) -> None:
        while not self._left.is_set():
            if self.supervisor is None:
                with self._changing:
                    self._process = subprocess.Popen(
                        [sys.executable, "-m", "stereomend", "serve"],
                        env=self._environment,
                        stdout=self._log,
                        stderr=self._log,
                    )
                    self.starts += 1
            self._left.wait(_PAUSE_S)

    def _start(self) -> None:
        self._manager.start()

    def _end(self) -> None:
        self._left.set()
        self._manager.join()
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.wait(30)
            except subprocess.TimeoutExpired:
                self._process.kill()
        self._log.close()
        for pid in self.all_processes():
            kill(pid)


@contextmanager
def service(folder: Path, **settings: object) -> Iterator[Service]:
    """Run a service in `folder`/data, ready when this returns; its log is `folder`/service.log."""
    running = Service(folder / "data", settings, folder / "service.log")
    running._start()
    try:
        until(running.ready, "the service is ready")
        yield running
    finally:
        running._end()


def until(condition: Callable[[], object], what: str, seconds: float = READY_S) -> float:
    """Wait until something holds and return how long it took [s] (raises TimeoutError)."""
    began = time.monotonic()
    while not condition():
        if time.monotonic() - began > seconds:
            raise TimeoutError(f"not in {seconds:g} s: {what}")
        time.sleep(0.01)
    return time.monotonic() - began


def kill(pid: int | None, number: int = signal.SIGKILL) -> bool:
    """Send a signal; whether there was such a process."""
    try:
        if pid is not None:
            os.kill(pid, number)
        return pid is not None
    except ProcessLookupError:
        return False


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port: int = one.getsockname()[1]
        return port
