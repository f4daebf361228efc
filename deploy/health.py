"""Whether a container does its work: `python health.py ROLE`; 0 if so, 1 if not."""

import socket
import sys
from urllib.request import urlopen

import psutil

CONTROLLER_PORT = 8440
HUB_PORT = 8441
WITHIN_S = 3.0


def controller_answers() -> bool:
    """Whether the controller answers and reaches its database."""
    with urlopen(f"http://127.0.0.1:{CONTROLLER_PORT}/readyz", timeout=WITHIN_S) as answer:
        return bool(answer.status == 200)


def hub_listens() -> bool:
    """Whether workers can connect to the hub."""
    with socket.create_connection(("127.0.0.1", HUB_PORT), timeout=WITHIN_S):
        return True


def worker_is_connected() -> bool:
    """Whether this container's worker holds a connection to the hub."""
    return any(
        connection.status == psutil.CONN_ESTABLISHED and connection.raddr[1] == HUB_PORT
        for connection in psutil.net_connections("tcp")
        if connection.raddr
    )


CHECKS = {
    "controller": controller_answers,
    "services": hub_listens,
    "worker": worker_is_connected,
}


def main(role: str) -> int:
    """The exit code for a role."""
    try:
        return 0 if CHECKS[role]() else 1
    except OSError:
        return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
