"""The server as its user starts it: the supervisor; and the same as a child for demonstrations and tests."""

# Without FastAPI, NumPy or OpenCV: the supervisor stays small.

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any

from stereomend.errors import ConfigurationError, NotReady
from stereomend.jobs.logs import configure_logging
from stereomend.jobs.supervisor import Supervised, Supervisor
from stereomend.settings import Settings, load_settings

_ANNOUNCEMENT = "Stereomend listens on "
_STOP_S = 20.0
_BACKLOG = 2048


def serve(settings: Settings) -> int:
    """Serve until SIGTERM or SIGINT; prints one line with the address when it is ready.

    Returns an exit code: 2 where the API process cannot start as told, which has then said why.

    Raises:
        ConfigurationError: the address cannot be listened on.
    """
    configure_logging(settings.log_format)
    with _listening(settings) as listener:
        line = f"{_ANNOUNCEMENT}{_url(listener, 'https' if settings.tls_certfile else 'http')}"
        supervised = Supervised(
            command=[sys.executable, "-m", "stereomend.api"],
            environment=os.environ | as_environment(settings),
            listener=listener,
            on_ready=lambda: print(line, flush=True),
            patience_s=_STOP_S,
        )
        return Supervisor(supervised).run()


@dataclass(frozen=True)
class ServerProcess:
    """A server in a child process."""

    url: str
    process: subprocess.Popen[str]
    """The supervisor."""


@contextmanager
def server_process(settings: Settings, log: IO[Any] | None = None) -> Generator[ServerProcess, None, None]:
    """Run a server as a child process, ready when this returns; its log goes to `log` or nowhere.

    Raises:
        NotReady: the server ended before it was ready.
    """
    command = [sys.executable, "-m", "stereomend", "serve"]
    environment = os.environ | as_environment(settings)
    process = subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=log or subprocess.DEVNULL, text=True
    )
    with process:
        try:
            yield ServerProcess(_announced(process), process)
        finally:
            _end_process(process)


@contextmanager
def background_server(settings: Settings, log: IO[Any] | None = None) -> Generator[str, None, None]:
    """Run a server as a child process and give its base URL (arguments and errors as `server_process`).

    Its data folder is a temporary one: that of the settings may have a server of its own.
    """
    with TemporaryDirectory(prefix="stereomend-") as folder:
        moved = settings.model_copy(update={"data_dir": Path(folder), "min_free_disk_mb": 0})
        with server_process(moved, log) as server:
            yield server.url


@contextmanager
def passing_server(**settings: Any) -> Generator[str, None, None]:
    """Run a server on a free port without keys, with a data folder that goes with it, and give its URL.

    Raises:
        NotReady: as `server_process`.
    """
    alone = {"host": "127.0.0.1", "port": 0, "api_keys": "", "tls_certfile": "", "tls_keyfile": ""}
    with (
        TemporaryDirectory(prefix="stereomend-") as folder,
        background_server(load_settings(data_dir=folder, **alone, **settings)) as url,
    ):
        yield url


def as_environment(settings: Settings) -> dict[str, str]:
    """Give settings as the variables that `load_settings` reads in another process."""
    values = settings.model_dump(exclude={"api_keys"}) | {
        "api_keys": ",".join(key.get_secret_value() for key in settings.api_keys)
    }
    # Empty is none, and hides what the environment says.
    return {
        f"STEREOMEND_{name.upper()}": "" if value is None else str(value) for name, value in values.items()
    }


def _listening(settings: Settings) -> socket.socket:
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    # Named TCP, or asyncio would leave Nagle's algorithm on, which delays answers by 40 ms.
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((settings.host, settings.port))
        listener.listen(_BACKLOG)
        return listener
    except OSError as error:
        listener.close()
        raise ConfigurationError(
            f"cannot listen on {settings.host} port {settings.port}: {error.strerror}"
        ) from error


def _url(listener: socket.socket, scheme: str) -> str:
    host, port, *_ = listener.getsockname()
    return f"{scheme}://[{host}]:{port}" if ":" in host else f"{scheme}://{host}:{port}"


def _announced(process: subprocess.Popen[str]) -> str:
    line = process.stdout.readline() if process.stdout else ""
    if not line.startswith(_ANNOUNCEMENT):
        raise NotReady(
            f"the server ended with exit code {process.wait()} before it was ready; its log says why"
        )
    return line.removeprefix(_ANNOUNCEMENT).strip()


def _end_process(process: subprocess.Popen[str]) -> None:
    process.terminate()
    try:
        process.wait(2 * _STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
