"""OpenTelemetry: a span per request, and in it one per stage of a worker, built from what the worker timed.

Needs the extra `otel`; `api/app.py` imports this only where spans are to be exported.
"""

from __future__ import annotations

import os
import time
from importlib.metadata import version

from opentelemetry.context import Context
from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
from opentelemetry.sdk.resources import SERVICE_NAME, SERVICE_VERSION, Resource
from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import BatchSpanProcessor, SpanExporter
from opentelemetry.trace import Span, SpanKind, StatusCode, format_trace_id, set_span_in_context
from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from stereomend.api.envelope import method_of
from stereomend.errors import StereomendError
from stereomend.jobs.listener import Listener
from stereomend.jobs.task import TIMINGS, Answer, Task

_FIRST_SERVER_ERROR = 500
_STAGES = tuple(name for name in TIMINGS if name != "total")
_PROPAGATOR = TraceContextTextMapPropagator()


class Tracing(Listener):
    """Makes spans and exports them in a thread of its own, until `stop`."""

    def __init__(self, exporter: SpanExporter | None = None) -> None:
        resource = Resource.create(
            {
                SERVICE_NAME: os.environ.get("OTEL_SERVICE_NAME", "stereomend"),
                SERVICE_VERSION: version("stereomend"),
            }
        )
        self._provider = TracerProvider(resource=resource, shutdown_on_exit=False)
        # The default exporter reads OTEL_EXPORTER_OTLP_* itself.
        self._provider.add_span_processor(BatchSpanProcessor(exporter or OTLPSpanExporter()))
        self._tracer = self._provider.get_tracer("stereomend", version("stereomend"))

    def begin(self, scope: Scope) -> Span:
        """Open the span of a request, a child of the one that its `traceparent` names."""
        headers = Headers(scope=scope)
        carrier = {name: headers[name] for name in ("traceparent", "tracestate") if name in headers}
        method = method_of(scope)
        attributes = {"http.request.method": method, "url.scheme": scope["scheme"]}
        span = self._tracer.start_span(
            method, _PROPAGATOR.extract(carrier, Context()), SpanKind.SERVER, attributes
        )
        scope["state"]["traceparent"] = _traceparent(span)
        scope["state"]["trace_id"] = format_trace_id(span.get_span_context().trace_id)
        return span

    def answered(self, task: Task, outcome: Answer | StereomendError) -> None:
        """Add the spans of the stages that a worker ran."""
        if task.traceparent is None or not isinstance(outcome, Answer):
            return
        parent = _PROPAGATOR.extract({"traceparent": task.traceparent}, Context())
        began = time.time_ns() - _ns(outcome.timings["total"])
        for stage in _STAGES:
            ended = began + _ns(outcome.timings[stage])
            if ended > began:
                self._tracer.start_span(stage, parent, start_time=began).end(ended)
            began = ended

    def stop(self) -> None:
        """Export what is left; blocks for as long as the exporter does."""
        self._provider.shutdown()


class Traced:
    """ASGI middleware: opens and ends the span of each request. Paths and files are not told, routes are."""

    def __init__(self, app: ASGIApp, tracing: Tracing) -> None:
        self._app = app
        self._tracing = tracing

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request within a span."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        span = self._tracing.begin(scope)

        async def watched(message: Message) -> None:
            if message["type"] == "http.response.start":
                _tell_status(span, message["status"])
            await send(message)

        try:
            await self._app(scope, receive, watched)
        except Exception:
            span.set_status(StatusCode.ERROR)
            raise
        finally:
            _tell_route(span, scope)
            span.end()


def _tell_status(span: Span, status: int) -> None:
    span.set_attribute("http.response.status_code", status)
    if status >= _FIRST_SERVER_ERROR:
        span.set_status(StatusCode.ERROR)


def _tell_route(span: Span, scope: Scope) -> None:
    state = scope["state"]
    span.update_name(f"{method_of(scope)} {state['route']}")
    span.set_attribute("http.route", state["route"])
    span.set_attribute("stereomend.request_id", state["request_id"])


def _traceparent(span: Span) -> str:
    carrier: dict[str, str] = {}
    _PROPAGATOR.inject(carrier, set_span_in_context(span, Context()))
    return carrier.get("traceparent", "")


def _ns(milliseconds: float) -> int:
    return round(1e6 * milliseconds)
