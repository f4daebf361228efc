"""Ray places the workers and starts them again; it is never asked what happened."""

import logging
import os
import platform
import signal
import socket
from typing import Any, Protocol

from eigenfail import plugins
from eigenfail.errors import ClusterUnavailable
from eigenfail.wire.curve import WorkerKey

ENVIRONMENT = {
    "RAY_AUTH_MODE": "token",
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
}
GOODBYE_S = 3.0
KNOCK_S = 5.0


class Launcher(Protocol):
    """Starts workers somewhere, and takes them down again."""

    def start(self, hub: str, key: WorkerKey | None = None) -> None:
        """Have workers connect to the hub, with a key where it asks for one.

        Raises:
            ClusterUnavailable: there is nowhere to start them.
        """

    def stop(self) -> None:
        """Wait for those that were sent home, and end the rest."""


class NoLauncher:
    """For workers that are started by hand."""

    def start(self, hub: str, key: WorkerKey | None = None) -> None:
        """Nothing to do."""

    def stop(self) -> None:
        """Nothing to do."""


def knock(address: str | None) -> None:
    """See whether anybody listens there: Ray itself would try for minutes.

    Raises:
        OSError: nobody does.
    """
    host, _, port = (address or "").rpartition(":")
    if host and port.isdecimal():
        socket.create_connection((host.rpartition("/")[2], int(port)), KNOCK_S).close()


class RayLauncher:
    """Workers as Ray actors, on a cluster or on a Ray of one machine that it starts.

    Args:
        workers: how many.
        address: of a running cluster; None starts Ray on this machine for as long as it lasts.
    """

    def __init__(self, workers: int, address: str | None = None) -> None:
        self._workers = workers
        self._address = address
        self._actors: list[Any] = []
        self._runs: list[Any] = []

    def start(self, hub: str, key: WorkerKey | None = None) -> None:
        """Connect to Ray, and ask it for the workers.

        Raises:
            ClusterUnavailable: Ray is not installed, or does not start.
        """
        self.connect()
        self.ask(hub, key)

    def connect(self) -> None:
        """Connect to the cluster, or start one.

        Raises:
            ClusterUnavailable: Ray is not installed, or does not start.
        """
        for name, value in ENVIRONMENT.items():
            os.environ.setdefault(name, value)
        try:
            import ray

            knock(self._address)
            options: dict[str, Any] = {"address": self._address} if self._address else self._local()
            orderly = signal.getsignal(signal.SIGTERM)
            ray.init(log_to_driver=False, logging_level=logging.WARNING, **options)
            # Ray takes SIGTERM for itself, and ends the process in the middle of whatever it does.
            signal.signal(signal.SIGTERM, orderly)
        except (ImportError, OSError, RuntimeError, ValueError) as error:
            raise ClusterUnavailable(
                f"Ray cannot be used: {error}.",
                "Install eigenfail[worker], check the cluster's address, or start with "
                "`--launcher none` and workers by `eigenfail worker --connect`.",
            ) from error

    def _local(self) -> dict[str, Any]:
        return {
            "num_cpus": self._workers,
            "num_gpus": 0,
            "include_dashboard": False,
            "_node_ip_address": "127.0.0.1",
        }

    def ask(self, hub: str, key: WorkerKey | None = None) -> None:
        """Ask for the actors; each says hello to the hub when Ray has placed it."""
        import ray

        actor = plugins.load(plugins.WORKER_ACTORS, "ray")
        # Ray starts a dead worker again and calls its `run` anew; the hub leases to it afresh.
        remote = ray.remote(num_cpus=1, max_restarts=-1, max_task_retries=-1)(actor)
        self._actors = [remote.remote() for _ in range(self._workers)]
        self._runs = [
            worker.run.remote(hub, f"{platform.node()}-{os.getpid()}.{number}", key)
            for number, worker in enumerate(self._actors)
        ]

    def dismiss(self) -> None:
        """End the workers that have not left by themselves."""
        import ray

        ray.wait(self._runs, num_returns=len(self._runs), timeout=GOODBYE_S)
        for actor in self._actors:
            ray.kill(actor)

    def stop(self) -> None:
        """Wait a moment for the workers to leave by themselves, then let go of Ray."""
        import ray

        if ray.is_initialized():
            self.dismiss()
            ray.shutdown()
