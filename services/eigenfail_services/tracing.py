"""Traces for OpenTelemetry: nothing unless an endpoint is set by OpenTelemetry's own variables."""

import os
from collections.abc import Callable
from contextlib import AbstractContextManager

from opentelemetry import trace
from opentelemetry.trace import Span
from opentelemetry.util.types import AttributeValue

from eigenfail import __version__
from eigenfail.errors import InvalidValue

ENDPOINTS = ("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT")

TRACER = trace.get_tracer("eigenfail", __version__)


def nothing() -> None:
    """Nothing was begun, so that nothing has to be ended."""


def configure(process: str) -> Callable[[], None]:
    """Send spans where the environment says; what sends the last of them and ends that.

    Args:
        process: which one of the service it is; `OTEL_SERVICE_NAME` has the last word.

    Raises:
        InvalidValue: an endpoint is set, but what speaks to it is not installed.
    """
    asked = next((name for name in ENDPOINTS if os.environ.get(name)), None)
    if asked is None:
        return nothing
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.resources import Resource
        from opentelemetry.sdk.trace import TracerProvider
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    except ImportError as error:
        raise InvalidValue(
            asked,
            "traces cannot be sent from here.",
            "Install eigenfail[otel], or leave it unset.",
        ) from error
    name = os.environ.get("OTEL_SERVICE_NAME") or f"eigenfail-{process}"
    facts = {"service.name": name, "service.version": __version__}
    provider = TracerProvider(resource=Resource.create(facts), shutdown_on_exit=False)
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    trace.set_tracer_provider(provider)
    return provider.shutdown


def span(name: str, **facts: AttributeValue) -> AbstractContextManager[Span]:
    """What the block does, with `eigenfail.` before the name of each fact."""
    attributes = {f"eigenfail.{key}": value for key, value in facts.items()}
    return TRACER.start_as_current_span(name, attributes=attributes)
