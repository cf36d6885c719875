"""The API process: one uvicorn on a socket that the supervisor holds."""

from __future__ import annotations

import asyncio
import os
import socket
import sys

import uvicorn
import uvloop

from stereomend.api.app import create_app, running
from stereomend.api.protocol import protocol_with
from stereomend.api.state import Service
from stereomend.api.tls import tls_context
from stereomend.errors import ConfigurationError
from stereomend.jobs.logs import configure_logging
from stereomend.jobs.memory import keep_freed_memory
from stereomend.jobs.pool import GRACE_S
from stereomend.jobs.supervisor import READY
from stereomend.settings import Settings, load_settings

STOP_S = GRACE_S + 5
"""The longest that ending takes, connections included."""


def serve_on(listener: socket.socket, lifeline: socket.socket) -> int:
    """Serve until SIGTERM or SIGINT, as the environment says; returns an exit code, 2 for bad settings."""
    try:
        settings = load_settings()
        # Workers inherit the environment.
        os.environ.pop("STEREOMEND_API_KEYS", None)
        configure_logging(settings.log_format)
        keep_freed_memory()
        uvloop.run(_serve(settings, listener, lifeline))
    except ConfigurationError as error:
        print(f"stereomend: {error}", file=sys.stderr)
        return 2
    return 0


class _Server(uvicorn.Server):
    """Stops the work while connections drain: what runs is answered, what waits is refused or kept."""

    def __init__(self, config: uvicorn.Config, service: Service) -> None:
        super().__init__(config)
        self._service = service

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End all connections."""
        await asyncio.gather(self._service.jobs.stop(), super().shutdown(sockets))


async def _serve(settings: Settings, listener: socket.socket, lifeline: socket.socket) -> None:
    tls = tls_context(settings)
    app = create_app(settings)
    # The lifespan is run here and not by uvicorn, which would swallow a ConfigurationError.
    config = uvicorn.Config(
        app,
        http=protocol_with(settings.max_upload_mb << 20, app.state.service.meters),
        lifespan="off",
        log_config=None,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=round(STOP_S),
        ssl_context_factory=(lambda config, default: tls) if tls else None,
    )
    async with running(app):
        lifeline.send(READY)
        await _Server(config, app.state.service).serve([listener])
