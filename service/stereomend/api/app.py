"""The ASGI application: routes, middleware and workers, wired together."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from importlib.metadata import version

from fastapi import Depends, FastAPI
from fastapi.security import HTTPBearer

from stereomend.api.envelope import Envelope
from stereomend.api.openapi import describe
from stereomend.api.problems import add_handlers
from stereomend.api.routes import docs, health, jobs, presets, refine
from stereomend.api.security import Gate
from stereomend.api.state import Service
from stereomend.jobs.pool import WorkerPool
from stereomend.jobs.service import JobService
from stereomend.settings import Settings

_KEY = Depends(HTTPBearer(auto_error=False, description="API key; not needed where the server has none"))


def create_app(settings: Settings) -> FastAPI:
    """Build the application; its lifespan opens the data folder, starts the workers and ends them."""
    app = FastAPI(
        title="Stereomend",
        version=version("stereomend"),
        description="Mends the disparity maps that stereo networks get wrong on laparoscopic images.",
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
        lifespan=running,
    )
    pool = WorkerPool(settings)
    app.state.service = Service(settings, pool, JobService(settings, pool))
    for router in (refine.router, jobs.router, presets.router):
        app.include_router(router, dependencies=[_KEY])
    for router in (health.router, docs.router):
        app.include_router(router)
    app.mount(docs.ASSETS_PATH, docs.assets())
    add_handlers(app)
    app.add_middleware(Gate, settings=settings)
    app.add_middleware(Envelope)
    describe(app)
    return app


@asynccontextmanager
async def running(app: FastAPI) -> AsyncGenerator[None, None]:
    """Keep an application's jobs and workers running (raises ConfigurationError if they cannot start)."""
    service: Service = app.state.service
    try:
        await service.jobs.start()
        await service.pool.start()
        yield
    finally:
        await service.jobs.stop()
