"""Whether a container does its work: `python health.py [ROLE]`; 0 if so, 1 if not.

Without an argument the role is EIGENFAIL_ROLE, and where that is not set nothing is asked. The
ports are those of EIGENFAIL_HEALTH_PORT (or EIGENFAIL_PORT), EIGENFAIL_HUB_PORT and
EIGENFAIL_RAY_PORT.
"""

import os
import socket
import sys
from urllib.request import urlopen

import psutil

WITHIN_S = 3.0


def port(name: str, otherwise: int) -> int:
    """A port of the environment."""
    return int(os.environ.get(f"EIGENFAIL_{name}", otherwise))


def controller_answers() -> bool:
    """Whether the controller answers and reaches its database."""
    address = f"http://127.0.0.1:{port('HEALTH_PORT', port('PORT', 8440))}/readyz"
    with urlopen(address, timeout=WITHIN_S) as answer:
        return bool(answer.status == 200)


def hub_listens() -> bool:
    """Whether workers can connect to the hub."""
    with socket.create_connection(("127.0.0.1", port("HUB_PORT", 8441)), timeout=WITHIN_S):
        return True


def worker_is_connected() -> bool:
    """Whether this container's worker holds a connection to the hub."""
    return connected_to(port("HUB_PORT", 8441))


def ray_listens() -> bool:
    """Whether nodes can connect to this container's head of Ray."""
    wanted = port("RAY_PORT", 6379)
    return any(
        connection.status == psutil.CONN_LISTEN and connection.laddr[1] == wanted
        for connection in psutil.net_connections("tcp")
    )


def node_is_connected() -> bool:
    """Whether this container's node of Ray holds a connection to the head."""
    return connected_to(port("RAY_PORT", 6379))


def connected_to(there: int) -> bool:
    """Whether a connection from here to such a port stands."""
    return any(
        connection.status == psutil.CONN_ESTABLISHED and connection.raddr[1] == there
        for connection in psutil.net_connections("tcp")
        if connection.raddr
    )


CHECKS = {
    "": lambda: True,
    "controller": controller_answers,
    "services": hub_listens,
    "worker": worker_is_connected,
    "ray-head": ray_listens,
    "ray-node": node_is_connected,
}


def main(role: str) -> int:
    """The exit code for a role."""
    try:
        return 0 if CHECKS[role]() else 1
    except OSError:
        return 1


if __name__ == "__main__":
    sys.exit(main((*sys.argv[1:], os.environ.get("EIGENFAIL_ROLE", ""))[0]))
