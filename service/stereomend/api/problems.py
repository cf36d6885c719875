"""Errors as RFC 9457 problem documents: the one place that knows HTTP statuses."""

from __future__ import annotations

import json
import math
from http import HTTPStatus
from typing import Any, cast

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response
from starlette.routing import Match, Route
from starlette.types import Scope

from stereomend import errors
from stereomend.errors import StereomendError

MEDIA_TYPE = "application/problem+json"

STATUSES: dict[type[StereomendError], int] = {
    errors.StereomendError: 500,
    errors.InputError: 400,
    errors.UnknownFormat: 415,
    errors.DamagedFile: 422,
    errors.BodyTooLarge: 413,
    errors.TooManyPixels: 413,
    errors.InvalidParameter: 422,
    errors.ShapeMismatch: 422,
    errors.NoValidDisparity: 422,
    errors.DisparityOutOfRange: 422,
    errors.NotAcceptable: 406,
    errors.NotFound: 404,
    errors.ResultExpired: 410,
    errors.IdempotencyMismatch: 422,
    errors.Conflict: 409,
    errors.AccessDenied: 401,
    errors.Forbidden: 403,
    errors.Unavailable: 503,
    errors.QueueFull: 429,
    errors.DiskFull: 507,
    errors.InternalError: 500,
}
"""A class that is not listed has the status of its base."""

_OF_THE_FRAMEWORK: dict[int, type[StereomendError]] = {
    400: errors.MalformedRequest,
    404: errors.NotFound,
    405: errors.NotFound,
    413: errors.BodyTooLarge,
}
_LONGEST_DETAIL = 2000
_CLIENT_CLOSED_REQUEST = 499


class Problem(Response):
    """An error as a response; `status` overrides what the error's class says."""

    media_type = MEDIA_TYPE

    def __init__(self, error: StereomendError, scope: Scope, status: int | None = None) -> None:
        status = status or status_of(type(error))
        document = problem_document(error, scope["state"]["request_id"]) | {"status": status}
        scope["state"]["problem"] = error.slug
        # Escaped, since a detail may quote half a surrogate pair that a client sent.
        body = json.dumps(document).encode()
        super().__init__(body, status, _headers(error, status, scope))


def problem_document(error: StereomendError, request_id: str) -> dict[str, Any]:
    """An error as the members of a problem document."""
    return {
        "type": f"/problems/{error.slug}",
        "title": error.title,
        "status": status_of(type(error)),
        "detail": str(error)[:_LONGEST_DETAIL],
        "request_id": request_id,
    }


def status_of(error: type[StereomendError]) -> int:
    """The HTTP status of a class of errors."""
    return next(STATUSES[base] for base in error.__mro__ if base in STATUSES)


def add_handlers(app: FastAPI) -> None:
    """Answer every error of ours and of the framework's with a problem document."""
    app.add_exception_handler(StereomendError, _ours)
    app.add_exception_handler(HTTPException, _framework)
    app.add_exception_handler(RequestValidationError, _validation)
    app.add_exception_handler(ClientDisconnect, _gone)


async def _ours(request: Request, error: Exception) -> Response:
    return Problem(cast(StereomendError, error), request.scope)


async def _framework(request: Request, error: Exception) -> Response:
    failure = cast(HTTPException, error)
    kind = _OF_THE_FRAMEWORK.get(failure.status_code, errors.StereomendError)
    detail = f"{failure.detail}: {request.method} {request.url.path}"
    response = Problem(kind(detail), request.scope, failure.status_code)
    response.headers.update(failure.headers or {})
    if failure.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        response.headers["Allow"] = ", ".join(sorted(_methods(request)))
    return response


def _methods(request: Request) -> set[str]:
    """What the resource can be asked: the framework names only the methods of its first route."""
    routes = [route for route in request.app.state.routes if isinstance(route, Route)]
    return {
        method
        for route in routes
        if route.matches(request.scope)[0] is not Match.NONE
        for method in route.methods or ()
    }


async def _validation(request: Request, error: Exception) -> Response:
    faults = cast(RequestValidationError, error).errors()
    detail = "; ".join(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in faults)
    return Problem(errors.InvalidParameter(detail), request.scope)


async def _gone(request: Request, error: Exception) -> Response:
    return Response(status_code=_CLIENT_CLOSED_REQUEST)


def _headers(error: StereomendError, status: int, scope: Scope) -> dict[str, str]:
    headers = {}
    if error.retry_after is not None:
        headers["Retry-After"] = str(max(1, math.ceil(error.retry_after)))
    if status == HTTPStatus.UNAUTHORIZED:
        headers["WWW-Authenticate"] = 'Bearer realm="stereomend"'
    if status in (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN, HTTPStatus.REQUEST_ENTITY_TOO_LARGE):
        headers |= _without_the_rest(scope)
    return headers


def _without_the_rest(scope: Scope) -> dict[str, str]:
    # The server would otherwise read a refused body to its end to keep the connection.
    has_body = any(name in (b"content-length", b"transfer-encoding") for name, _ in scope["headers"])
    return {"Connection": "close"} if has_body else {}
