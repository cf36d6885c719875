"""The server process: one uvicorn, and the same as a child process for demonstrations and tests."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import ssl
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import IO, Any, NoReturn

import uvicorn

from stereomend.api.app import create_app, running
from stereomend.api.tls import tls_context
from stereomend.errors import ConfigurationError, NotReady
from stereomend.jobs.logs import configure_logging
from stereomend.jobs.memory import keep_freed_memory
from stereomend.jobs.pool import GRACE_S, WorkerPool
from stereomend.settings import Settings

_ANNOUNCEMENT = "Stereomend listens on "
_STOP_S = GRACE_S + 5
_BACKLOG = 2048


def serve(settings: Settings) -> None:
    """Serve until SIGTERM or SIGINT; prints one line with the address when it is ready.

    Raises:
        ConfigurationError: the address cannot be listened on or needs a key, the certificate cannot be used,
            or no worker can start as told.
    """
    configure_logging(settings.log_format)
    keep_freed_memory()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _end)
    tls = tls_context(settings)
    with _listening(settings) as listener:
        asyncio.run(_serve(settings, listener, tls))


@dataclass(frozen=True)
class ServerProcess:
    """A server in a child process."""

    url: str
    process: subprocess.Popen[str]


@contextmanager
def server_process(settings: Settings, log: IO[Any] | None = None) -> Generator[ServerProcess, None, None]:
    """Run a server as a child process, ready when this returns; its log goes to `log` or nowhere.

    Raises:
        NotReady: the server ended before it was ready.
    """
    command = [sys.executable, "-m", "stereomend", "serve"]
    environment = os.environ | _as_environment(settings)
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
    """Run a server as a child process and give its base URL (arguments and errors as `server_process`)."""
    with server_process(settings, log) as server:
        yield server.url


class _Server(uvicorn.Server):
    """Stops the pool while connections drain: what runs is answered, what waits is refused."""

    def __init__(self, config: uvicorn.Config, pool: WorkerPool) -> None:
        super().__init__(config)
        self._pool = pool

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End all connections."""
        await asyncio.gather(self._pool.stop(), super().shutdown(sockets))


async def _serve(settings: Settings, listener: socket.socket, tls: ssl.SSLContext | None) -> None:
    app = create_app(settings)
    # The lifespan is run here and not by uvicorn, which would swallow a ConfigurationError.
    config = uvicorn.Config(
        app,
        lifespan="off",
        log_config=None,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=round(_STOP_S),
        ssl_context_factory=(lambda config, default: tls) if tls else None,
    )
    async with running(app):
        print(f"{_ANNOUNCEMENT}{_url(listener, 'https' if tls else 'http')}", flush=True)
        await _Server(config, app.state.service.pool).serve([listener])


def _end(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit(0)


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


def _as_environment(settings: Settings) -> dict[str, str]:
    values = settings.model_dump(exclude={"api_keys"}) | {
        "api_keys": ",".join(key.get_secret_value() for key in settings.api_keys)
    }
    return {f"STEREOMEND_{name.upper()}": str(value) for name, value in values.items() if value is not None}


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
