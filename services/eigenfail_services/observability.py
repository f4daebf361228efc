"""Observability of the services: the port that Prometheus scrapes, and OpenTelemetry traces."""

import os
from collections.abc import Callable
from contextlib import AbstractContextManager

from opentelemetry import trace
from opentelemetry.trace import Span
from opentelemetry.util.types import AttributeValue
from prometheus_client import CollectorRegistry, ProcessCollector, start_http_server

from eigenfail import __version__
from eigenfail.addresses import TRUST_VARIABLE, is_loopback
from eigenfail.errors import InvalidValue, PortTaken

VARIABLE = "EIGENFAIL_METRICS"


def serve(address: str, registry: CollectorRegistry) -> Callable[[], None]:
    """Serve metrics at host:port on a thread; return the function that stops it.

    Raises:
        InvalidValue: no valid address, or one that other machines reach over an untrusted network.
        PortTaken: it cannot be listened on.
    """
    host, port = split_address(address)
    ProcessCollector(registry=registry)
    try:
        server, thread = start_http_server(port, host, registry)
    except OSError as error:
        raise PortTaken(
            f"{address} cannot be listened on: {error.strerror}.", "Choose another with --metrics."
        ) from error

    def end() -> None:
        server.shutdown()
        server.server_close()
        thread.join()

    return end


def split_address(address: str) -> tuple[str, int]:
    """Return the host and the port of an address.

    Raises:
        InvalidValue: no valid address, or one that other machines reach over an untrusted network.
    """
    host, _, port = address.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not (host and port.isdecimal() and 0 < int(port) < 65_536):
        raise InvalidValue("metrics", f"'{address}' is no address.", "Give host:port.")
    if not is_loopback(host) and os.environ.get(TRUST_VARIABLE) != "1":
        raise InvalidValue(
            "metrics",
            f"'{address}' can be reached from other machines, and it requires no key.",
            f"Listen on 127.0.0.1:PORT; on a private network, {TRUST_VARIABLE}=1 vouches for it.",
        )
    return host, int(port)


ENDPOINTS = ("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT")


TRACER = trace.get_tracer("eigenfail", __version__)


def nothing() -> None:
    """Do nothing: nothing was started that has to be stopped."""


def configure(process: str) -> Callable[[], None]:
    """Send spans to the configured endpoint; return the function that flushes and stops.

    Args:
        process: name of this process of the service; `OTEL_SERVICE_NAME` overrides it.

    Raises:
        InvalidValue: an endpoint is set, but its exporter is not installed.
    """
    asked = next((name for name in ENDPOINTS if os.environ.get(name)), None)
    if asked is None:
        return nothing
    try:
        # The exporter is an extra. Without it spans can be made, and are dropped.
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
    # The caller ends the provider in order with the other parts, not whenever Python exits.
    provider = TracerProvider(resource=Resource.create(facts), shutdown_on_exit=False)
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    trace.set_tracer_provider(provider)
    return provider.shutdown


def span(name: str, **facts: AttributeValue) -> AbstractContextManager[Span]:
    """Trace a block as a span, with `eigenfail.` before the name of each fact."""
    attributes = {f"eigenfail.{key}": value for key, value in facts.items()}
    return TRACER.start_as_current_span(name, attributes=attributes)
