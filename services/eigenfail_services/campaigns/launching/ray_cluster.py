"""The Ray on which workers are placed: one that runs somewhere, or one of this machine."""

import logging
import os
import socket
from typing import Any

import psutil

from eigenfail.errors import ClusterUnavailable

ENVIRONMENT = {
    "RAY_AUTH_MODE": "token",
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
}
ALONE = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0"}
"""With no cluster to be part of, Ray stays on loopback, on every system: else it listens at the
machine's own address even where 127.0.0.1 is asked for.
"""

KNOCK_S = 5.0
PARTS = frozenset({"gcs_server", "raylet"})
"""Processes of a Ray of one machine without which it is none."""


def knock(address: str | None) -> None:
    """See whether anybody listens there: Ray itself would try for minutes.

    Raises:
        OSError: nobody does.
    """
    host, _, port = (address or "").rpartition(":")
    if host and port.isdecimal():
        socket.create_connection((host.rpartition("/")[2], int(port)), KNOCK_S).close()


class Cluster:
    """A Ray that runs somewhere, or one of this machine that lasts as long as this process.

    Args:
        address: of a running one; None starts one.
        most: how many workers there is to be room for in one that is started.

    Raises:
        ClusterUnavailable: Ray is not installed, or does not start, or nobody is at the address.
    """

    def __init__(self, address: str | None, most: int) -> None:
        for name, value in (ENVIRONMENT if address else ENVIRONMENT | ALONE).items():
            os.environ.setdefault(name, value)
        try:
            import ray

            knock(address)
            options: dict[str, Any] = {"address": address} if address else local(most)
            ray.init(log_to_driver=False, logging_level=logging.WARNING, **options)
        except (ImportError, OSError, RuntimeError, ValueError) as error:
            raise ClusterUnavailable(
                f"Ray cannot be used: {error}.",
                "Install eigenfail[worker], check the cluster's address, or start with "
                "`--launcher none` and workers by `eigenfail worker --connect`.",
            ) from error
        self._node = ray.get_runtime_context().get_node_id()
        below = psutil.Process().children()
        self._parts = {part.name(): part for part in below if part.name() in PARTS}

    def machines(self) -> int:
        """How many live; waits as long as Ray does where its head is away.

        Raises:
            ClusterUnavailable: this machine is none of them any more.
        """
        import ray

        for name, part in self._parts.items():
            if not part.is_running() or part.status() == psutil.STATUS_ZOMBIE:
                raise ClusterUnavailable(f"Ray's process {name} has died.")
        alive = {node["NodeID"] for node in ray.nodes() if node["Alive"]}  # type: ignore[no-untyped-call]
        if self._node not in alive:
            raise ClusterUnavailable("Ray has given up this machine.")
        return len(alive)

    def close(self) -> None:
        """Let go of it; one that was started here ends."""
        import ray

        ray.shutdown()


def local(most: int) -> dict[str, Any]:
    """How a Ray of this machine is started."""
    return {
        "num_cpus": most,
        "num_gpus": 0,
        "include_dashboard": False,
        "_node_ip_address": "127.0.0.1",
    }
