"""What OpenAPI cannot infer: the multipart body, binary answers and problem documents."""

from __future__ import annotations

import json
from collections.abc import Sequence
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from stereomend.api.problems import MEDIA_TYPE
from stereomend.api.schemas import ProblemDocument
from stereomend.jobs.task import TIMINGS
from stereomend.refinement import COPIES

_VERSION = "3.0.3"  # the newest that the bundled Swagger UI draws
_TEXT = {"type": "string"}
_FILE = {"type": "string", "format": "binary"}
_REQUEST_ID = {"description": "names the request in the server's log; a given one is echoed", "schema": _TEXT}
_RETRY_AFTER = {"description": "seconds after which to try again", "schema": {"type": "integer"}}
_EXAMPLE = {"preset": "paper", "stages": ["ldr", "gdr"], "gdr": {"warps": 10}}

Responses = dict[int | str, dict[str, Any]]

REFINE_BODY = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["left", "right"],
                    "properties": {
                        "left": _FILE | {"description": "left image: PNG, JPEG, TIFF, BMP, PNM or NPY"},
                        "right": _FILE | {"description": "right image, rectified with the left, of its size"},
                        "disparity": _FILE
                        | {"description": "the map to mend [px], of their size: 16-bit PNG, NPY, PFM, TIFF"},
                        "mask": _FILE
                        | {"description": "one channel, of their size: 0 is not part of the scene"},
                        "params": _TEXT
                        | {"description": "JSON object; see `/v1/presets`", "example": json.dumps(_EXAMPLE)},
                    },
                }
            }
        },
    }
}


def refined(media_types: Sequence[str]) -> Responses:
    """Describe the answer 200 of a refinement."""
    meta = "JSON: version, kernel hash, preset, backend, levels and quality; not with application/zip"
    timing = (
        f"milliseconds of {', '.join(TIMINGS)}; where a GPU computed also {' and '.join(COPIES)}: "
        "the copies to it and back, part of gdr"
    )
    answer = {
        "description": "The refined disparity map.",
        "content": {media_type: {"schema": _FILE} for media_type in media_types},
        "headers": {
            "X-Request-ID": _REQUEST_ID,
            "Stereomend-Meta": {"description": meta, "schema": _TEXT},
            "Server-Timing": {"description": timing, "schema": _TEXT},
        },
    }
    return {200: answer}


def problems(*statuses: int) -> Responses:
    """Describe problem documents as the answers with these statuses."""
    return {status: _problem(HTTPStatus(status)) for status in statuses}


def describe(app: FastAPI) -> None:
    """Make the application's OpenAPI document complete; it is built when first asked for."""

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _document(app)
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]


def _document(app: FastAPI) -> dict[str, Any]:
    document = get_openapi(
        title=app.title,
        version=app.version,
        description=app.description,
        openapi_version=_VERSION,
        routes=app.routes,
    )
    schema = ProblemDocument.model_json_schema()
    schema["properties"]["type"]["example"] = schema["properties"]["type"].pop("examples")[0]
    document["components"]["schemas"]["Problem"] = schema
    return document


def _problem(status: HTTPStatus) -> dict[str, Any]:
    headers = {"X-Request-ID": _REQUEST_ID}
    if status in (HTTPStatus.TOO_MANY_REQUESTS, HTTPStatus.SERVICE_UNAVAILABLE):
        headers["Retry-After"] = _RETRY_AFTER
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {"description": status.phrase, "headers": headers, "content": content}
