"""What OpenAPI cannot infer: the multipart body, headers, binary answers, problem documents and examples."""

from __future__ import annotations

import json
from collections.abc import Sequence
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic import BaseModel

from stereomend.api import examples
from stereomend.api.openapi30 import as_openapi_30
from stereomend.api.problems import MEDIA_TYPE
from stereomend.api.schemas import ProblemDocument
from stereomend.jobs.task import TIMINGS
from stereomend.refinement import COPIES

_VERSION = "3.0.3"  # the newest that the bundled Swagger UI draws
_JSON = "application/json"
_TEXT = {"type": "string"}
_FILE = {"type": "string", "format": "binary"}
_SECONDS = {"type": "integer", "minimum": 0}

Responses = dict[int | str, dict[str, Any]]


def _header(description: str, schema: dict[str, Any] = _TEXT) -> dict[str, Any]:
    return {"description": description, "schema": schema}


def _parameter(name: str, description: str, **schema: Any) -> dict[str, Any]:
    return {"name": name, "in": "header", "description": description, "schema": _TEXT | schema}


_HEADERS = {
    "X-Request-ID": _header("names the request in the server's log; a given one is echoed"),
    "ETag": _header("send it as `If-None-Match` to get 304 while nothing has changed"),
    "Location": _header("path of the job"),
    "Preference-Applied": _header("the preferences that were honoured"),
    "Idempotency-Replayed": _header("`true` where the job is that of an earlier request"),
    "Retry-After": _header("seconds after which to try again", _SECONDS),
    "Stereomend-Meta": _header(
        "JSON: version, kernel hash, preset, backend, levels and quality; not with application/zip"
    ),
    "Server-Timing": _header(
        f"milliseconds of {', '.join(TIMINGS)}; where a GPU computed also {' and '.join(COPIES)}: "
        "the copies to it and back, part of gdr"
    ),
}

OF_ACCEPTED = ("Location", "ETag", "Idempotency-Replayed")
"""The headers of an answer that accepts a job."""

PREFER_JOB = _parameter(
    "Prefer",
    "`wait=N`: the result within N seconds, else the refinement goes on as a job; "
    "`respond-async`: a job at once",
    example="wait=10",
)
PREFER_WAIT = _parameter(
    "Prefer", "`wait=N`: answer when the job has changed, after N seconds at most", example="wait=30"
)
IDEMPOTENCY_KEY = _parameter(
    "Idempotency-Key",
    "of the client's choice; the same request with the same key is the same job",
    example="frame-17",
    minLength=1,
    maxLength=255,
)
IF_NONE_MATCH = _parameter("If-None-Match", "the `ETag` of what the client has", example='"4"')
LAST_EVENT_ID = _parameter("Last-Event-ID", "`id` of the last event that the client has seen", example="4")

_BODY: dict[str, Any] = {
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
                    "mask": _FILE | {"description": "one channel, of their size: 0 is not part of the scene"},
                    "params": _TEXT
                    | {
                        "description": "JSON object; see `/v1/presets`",
                        "example": json.dumps(examples.PARAMS),
                    },
                },
            }
        }
    },
}


def takes(*parameters: dict[str, Any], body: bool = False) -> dict[str, Any]:
    """Describe the headers that a route reads, and the multipart body of a refinement if it does."""
    return {"parameters": list(parameters)} | ({"requestBody": _BODY} if body else {})


def refined(media_types: Sequence[str], *headers: str) -> Responses:
    """Describe the answer 200 that is a result, with these headers besides those of every result."""
    names = ("Server-Timing", "Stereomend-Meta", *headers)
    content = {media_type: {"schema": _FILE} for media_type in media_types}
    return {200: _answer("The refined disparity map.", content, names)}


def document(status: int, model: type[BaseModel], example: object, *headers: str) -> Responses:
    """Describe an answer that is a JSON document."""
    # As text, since the framework would drop what is null in it; `_parse_examples` undoes it.
    content = {_JSON: {"example": json.dumps(example)}}
    description = (model.__doc__ or "").partition("\n")[0]
    return {status: _answer(description, content, headers) | {"model": model}}


def event_stream() -> Responses:
    """Describe the answer 200 that is a stream of events, and 204."""
    # OpenAPI 3.0 has no schema for events.
    content = {"text/event-stream": {"schema": {}, "example": examples.EVENTS}}
    return {
        200: _answer("Events; `data` of each is the job.", content, ()),
        204: _answer("The job has ended and the client has seen it; do not come again.", None, ()),
    }


def bare(status: int, description: str, *headers: str) -> Responses:
    """Describe an answer without a body."""
    return {status: _answer(description, None, headers)}


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
    document["components"]["schemas"]["ProblemDocument"] = ProblemDocument.model_json_schema()
    for path in document["paths"].values():
        for operation in path.values():
            _forget_validation_error(operation["responses"])
            _parse_examples(operation["responses"])
    for name in ("HTTPValidationError", "ValidationError"):
        document["components"]["schemas"].pop(name, None)
    rewritten: dict[str, Any] = as_openapi_30(document)
    return rewritten


def _forget_validation_error(responses: dict[str, Any]) -> None:
    # The framework adds its own form of 422 to every route that has a parameter.
    if "HTTPValidationError" in str(responses.get("422")):
        del responses["422"]


def _parse_examples(responses: dict[str, Any]) -> None:
    for response in responses.values():
        content = response.get("content", {}).get(_JSON, {})
        if "example" in content:
            content["example"] = json.loads(content["example"])


def _problem(status: HTTPStatus) -> dict[str, Any]:
    again = status in (HTTPStatus.TOO_MANY_REQUESTS, HTTPStatus.SERVICE_UNAVAILABLE, HTTPStatus.CONFLICT)
    schema = {"$ref": "#/components/schemas/ProblemDocument"}
    content = {MEDIA_TYPE: {"schema": schema, "example": examples.PROBLEMS[status]}}
    return _answer(status.phrase, content, ("Retry-After",) if again else ())


def _answer(description: str, content: dict[str, Any] | None, headers: Sequence[str]) -> dict[str, Any]:
    named = {name: _HEADERS[name] for name in ("X-Request-ID", *headers)}
    return {"description": description, "headers": named} | ({"content": content} if content else {})
