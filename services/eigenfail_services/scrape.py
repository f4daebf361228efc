"""Where Prometheus scrapes the services process: an HTTP port of its own."""

import argparse
import os
from collections.abc import Callable

from prometheus_client import CollectorRegistry, ProcessCollector, start_http_server

from eigenfail.errors import InvalidValue, PortTaken
from eigenfail.loopback import TRUST_VARIABLE, is_loopback

VARIABLE = "EIGENFAIL_METRICS"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The option, with the environment behind it."""
    given = os.environ.get(VARIABLE, "")
    parser.add_argument("--metrics", default=given, help="host:port where Prometheus may scrape")


def serve(address: str, registry: CollectorRegistry) -> Callable[[], None]:
    """Serve the figures at host:port, on a thread; what ends that.

    Raises:
        InvalidValue: it is no address, or other machines reach it and nobody vouches for them.
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
    """Host and port.

    Raises:
        InvalidValue: it is no address, or other machines reach it and nobody vouches for them.
    """
    host, _, port = address.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not (host and port.isdecimal() and 0 < int(port) < 65_536):
        raise InvalidValue("metrics", f"'{address}' is no address.", "Give host:port.")
    if not is_loopback(host) and os.environ.get(TRUST_VARIABLE) != "1":
        raise InvalidValue(
            "metrics",
            f"'{address}' can be reached from other machines, and it asks nobody for a key.",
            f"Listen on 127.0.0.1:PORT; on a private network, {TRUST_VARIABLE}=1 vouches for it.",
        )
    return host, int(port)
