"""GET /docs: Swagger UI from installed files, since an operating room has no internet."""

from __future__ import annotations

import base64
import hashlib
import re

from fastapi import APIRouter
from fastapi.openapi.docs import get_swagger_ui_html
from starlette.responses import HTMLResponse
from starlette.staticfiles import StaticFiles
from swagger_ui_bundle import swagger_ui_path  # type: ignore[import-untyped]

from stereomend.api.envelope import NO_DETOURS

router = APIRouter()

ASSETS_PATH = "/docs/assets"


def assets() -> StaticFiles:
    """The files of Swagger UI, to be mounted at `ASSETS_PATH`."""
    return StaticFiles(directory=swagger_ui_path)


@router.get("/docs", include_in_schema=False)
async def docs() -> HTMLResponse:
    """Show the API to a browser."""
    page = get_swagger_ui_html(
        title="Stereomend",
        openapi_url="/openapi.json",
        swagger_js_url=f"{ASSETS_PATH}/swagger-ui-bundle.js",
        swagger_css_url=f"{ASSETS_PATH}/swagger-ui.css",
        swagger_favicon_url=f"{ASSETS_PATH}/favicon-32x32.png",
        # Its default sends the document to a validator on the internet.
        swagger_ui_parameters={"validatorUrl": None},
    )
    page.headers["Content-Security-Policy"] = _policy(bytes(page.body).decode())
    return page


def _policy(page: str) -> str:
    # Swagger UI styles its elements in place, and its style sheet holds its icons.
    hashes = [
        base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        for script in re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    ]
    scripts = " ".join(f"'sha256-{digest}'" for digest in hashes)
    return (
        f"default-src 'none'; script-src 'self' {scripts}; style-src 'self' 'unsafe-inline'; "
        f"img-src 'self' data:; connect-src 'self'; {NO_DETOURS}"
    )
