"""The ASGI application: routes, middleware and workers, wired together."""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING

from fastapi import Depends, FastAPI
from fastapi.security import HTTPBearer
from starlette.routing import Mount, Route

from stereomend.api.envelope import Envelope
from stereomend.api.keyring import KeyRing
from stereomend.api.openapi import describe
from stereomend.api.problems import add_handlers
from stereomend.api.routes import docs, health, jobs, metrics, presets, refine
from stereomend.api.security import Gate
from stereomend.api.state import Service
from stereomend.jobs.keys import KeyStore
from stereomend.jobs.listener import Listener
from stereomend.jobs.meters import Meters
from stereomend.jobs.pool import WorkerPool
from stereomend.jobs.service import JobService
from stereomend.settings import Settings

if TYPE_CHECKING:
    from stereomend.api.tracing import Tracing

log = logging.getLogger(__name__)

_KEY = Depends(HTTPBearer(auto_error=False, description="API key; not needed where the server has none"))
_GUARDED = (refine.router, jobs.router, presets.router, metrics.router)
_OPEN = (health.router, docs.router)
_EXPORTED_TO = ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")


def create_app(settings: Settings, tracing: Tracing | None = None) -> FastAPI:
    """Build the application; its lifespan opens the data folder, starts the workers and ends them.

    Spans go to `tracing`; without one, to where OpenTelemetry's environment variables say.
    """
    app = FastAPI(
        title="Stereomend",
        version=version("stereomend"),
        description="Mends the disparity maps that stereo networks get wrong on laparoscopic images.",
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
        lifespan=running,
    )
    tracing, meters = tracing or _configured_tracing(), Meters()
    listeners: list[Listener] = [meters, tracing] if tracing else [meters]
    pool, ring = WorkerPool(settings, listeners), KeyRing(settings)
    app.state.service = Service(settings, pool, JobService(settings, pool, listeners), meters)
    app.state.ring, app.state.tracing = ring, tracing
    for router in _GUARDED:
        app.include_router(router, dependencies=[_KEY])
    for router in _OPEN:
        app.include_router(router)
    app.mount(docs.ASSETS_PATH, docs.assets())
    app.state.routes = _routes(app)
    add_handlers(app)
    _wrap(app, ring, meters, tracing)
    describe(app)
    return app


@asynccontextmanager
async def running(app: FastAPI) -> AsyncGenerator[None, None]:
    """Keep an application's jobs and workers running.

    Raises:
        ConfigurationError: they cannot start, or other machines may reach the server and it has no key.
    """
    service: Service = app.state.service
    try:
        await service.jobs.start()
        await app.state.ring.open(KeyStore(service.jobs.store.ledger.engine))
        await service.pool.start()
        yield
    finally:
        await service.jobs.stop()
        if app.state.tracing:
            await asyncio.to_thread(app.state.tracing.stop)


def _wrap(app: FastAPI, ring: KeyRing, meters: Meters, tracing: Tracing | None) -> None:
    # The last is the outermost.
    app.add_middleware(Gate, ring=ring)
    if tracing:
        from stereomend.api.tracing import Traced

        app.add_middleware(Traced, tracing=tracing)
    app.add_middleware(Envelope, meters=meters, routes=app.state.routes)


def _routes(app: FastAPI) -> list[Route | Mount]:
    # The framework keeps an included router whole, its routes hidden within.
    of_routers = (route for router in (*_GUARDED, *_OPEN) for route in router.routes)
    return [route for route in (*of_routers, *app.routes) if isinstance(route, Route | Mount)]


def _configured_tracing() -> Tracing | None:
    if not any(os.environ.get(name) for name in _EXPORTED_TO):
        return None
    try:
        from stereomend.api.tracing import Tracing
    except ModuleNotFoundError:
        log.warning("spans are not exported: that needs `pip install 'stereomend[otel]'`")
        return None
    return Tracing()
