"""What only this machine can reach: one rule for hub, bridges, API, figures and client."""

import re
from ipaddress import ip_address

ENDPOINT = re.compile(r"tcp://(?P<host>\[[^\[\]]+\]|[^\[\]:;/@]+):[^:;/@]+")
"""Of ZeroMQ, as one listens on it or connects to it."""

PIPE = "ipc://"

TRUST_VARIABLE = "EIGENFAIL_TRUST_NETWORK"
"""Where it is "1", somebody vouches for the network beyond this machine."""


def is_loopback(host: str) -> bool:
    """Whether a host is this machine itself: a number of loopback, or `localhost`.

    No other name is looked up: it may be another machine's by the time at which it is used.

    Args:
        host: without a port; an address of IPv6 with or without brackets.
    """
    bare = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    try:
        return ip_address(bare).is_loopback
    except ValueError:
        return bare.lower() == "localhost"


def is_own_endpoint(address: str) -> bool:
    """Whether an address of ZeroMQ is of this machine; what cannot be read is of another."""
    found = ENDPOINT.fullmatch(address)
    return address.startswith(PIPE) or (found is not None and is_loopback(found["host"]))
