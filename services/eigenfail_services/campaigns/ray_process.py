"""The process of Ray's driver: places workers as Ray actors, and reports their status.

Requests come over its standard input, reports go to its standard output; what Ray prints goes to
standard error. It ends with its input, and with the services.
"""

import logging
import os
import select
import socket
import sys
from collections.abc import Callable, Collection
from typing import Any, NoReturn

import msgspec
import psutil

from eigenfail import logs, plugins
from eigenfail.errors import ClusterUnavailable
from eigenfail.processes import die_with_parent, end_now
from eigenfail.wire.keys import WorkerKey, read_worker_key
from eigenfail_services.campaigns import ray_link

# Without the token, everyone who reaches Ray's ports could run code as this user. Ray sends no
# usage statistics: the service connects to nothing that its user has not named.
ENVIRONMENT = {
    "RAY_AUTH_MODE": "token",
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
}


ALONE = {
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",
    "RAY_ROTATION_MAX_BYTES": "5000000",
    "RAY_ROTATION_BACKUP_COUNT": "1",
}
"""With no cluster to be part of, Ray stays on loopback, on every system: else it listens at the
machine's own address even where 127.0.0.1 is asked for. The logs that it keeps of each of its
processes have a bound, workers among them: by default Ray keeps them whole.
"""


KNOCK_S = 5.0


PARTS = frozenset({"gcs_server", "raylet"})
"""Processes without which a Ray of one machine does not work."""


def check_reachable(address: str | None) -> None:
    """Make sure that an address accepts connections: Ray itself would try for minutes.

    Raises:
        OSError: no process listens there.
    """
    host, _, port = (address or "").rpartition(":")
    if host and port.isdecimal():
        socket.create_connection((host.rpartition("/")[2], int(port)), KNOCK_S).close()


class RayCluster:
    """A running Ray, or a Ray on this machine that lasts as long as this process.

    Args:
        address: address of a running Ray; None starts one.
        most: number of workers for which a started Ray needs room.
        folder: temporary folder of a started Ray; if empty, Ray chooses one.

    Raises:
        ClusterUnavailable: Ray is not installed, does not start, or does not answer.
    """

    def __init__(self, address: str | None, most: int, folder: str = "") -> None:
        for name, value in (ENVIRONMENT if address else ENVIRONMENT | ALONE).items():
            # What the operator has set stays.
            os.environ.setdefault(name, value)
        try:
            import ray

            check_reachable(address)
            options: dict[str, Any] = (
                {"address": address} if address else _local_options(most, folder)
            )
            # What workers print stays in Ray's own logs, which are bounded, and does not pass
            # through this process.
            ray.init(log_to_driver=False, logging_level=logging.WARNING, **options)
        except (ImportError, OSError, RuntimeError, ValueError) as error:
            raise ClusterUnavailable(
                f"Ray cannot be used: {error}.",
                "Install eigenfail[worker], check the cluster's address, or start with "
                "`--launcher none` and workers by `eigenfail worker --connect`.",
            ) from error
        self._node = ray.get_runtime_context().get_node_id()
        # Only a Ray that was started here has its processes below this one; those of a cluster are
        # not watched.
        below = psutil.Process().children()
        self._parts = {part.name(): part for part in below if part.name() in PARTS}

    def machines(self) -> int:
        """Return the number of live machines; waits as long as Ray does without a head node.

        Raises:
            ClusterUnavailable: this machine is not in the cluster any more.
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
        """Disconnect from Ray; a Ray that was started here ends."""
        import ray

        ray.shutdown()


def _local_options(most: int, folder: str) -> dict[str, Any]:
    return {
        "num_cpus": most,
        "num_gpus": 0,
        "include_dashboard": False,
        "_node_ip_address": "127.0.0.1",
        "_temp_dir": folder or None,
    }


GOODBYE_S = 3.0


class RayWorker:
    """One Ray actor that runs a worker, with its pending answers."""

    def __init__(self, actor: Any, hub: str, name: str, key: WorkerKey | None) -> None:
        self.actor = actor
        self.placed = actor.place.remote()
        self.run = actor.run.remote(hub, name, key)

    def is_placed(self) -> bool:
        """Return whether Ray has placed the worker."""
        return _is_settled(self.placed)

    def has_ended(self) -> bool:
        """Return whether the worker has ended."""
        return _is_settled(self.run)

    def problem(self) -> str:
        """Return why the worker ended without being asked to; empty otherwise."""
        import ray

        try:
            ray.get(self.run)
        except (ray.exceptions.RayError, Exception) as error:  # noqa: BLE001 - the worker's own, through Ray
            return str(error).strip().splitlines()[-1]
        return ""


def _is_settled(reference: Any) -> bool:
    """Return whether an answer has come, or never will."""
    import ray

    return bool(ray.wait([reference], timeout=0)[0])


class RayWorkers:
    """The workers that are wanted, as Ray actors by name.

    Args:
        hub: the address that they connect to.
        key: the key that they present there.
    """

    def __init__(self, hub: str, key: WorkerKey | None = None) -> None:
        import ray

        actor = plugins.load(plugins.WORKER_ACTORS, "ray")
        # Ray starts a dead worker again and calls its `run` anew; the hub leases to it afresh.
        self._remote = ray.remote(num_cpus=1, max_restarts=-1, max_task_retries=-1)(actor)
        self._told = hub, key
        self._workers: dict[str, RayWorker] = {}

    def want(self, names: Collection[str]) -> None:
        """Start new workers; end unwanted workers that have left or are not yet placed.

        Other unwanted workers work until the hub dismisses them.
        """
        for name in names:
            if name not in self._workers:
                hub, key = self._told
                self._workers[name] = RayWorker(self._remote.remote(), hub, name, key)
        for name in self._workers.keys() - set(names):
            worker = self._workers[name]
            if worker.has_ended() or not worker.is_placed():
                _end_actor(self._workers.pop(name))

    def standing(self, machines: int) -> ray_link.ClusterStatus:
        """Return the status: workers with a place, without a place, and workers that gave up."""
        placed = {name for name, worker in self._workers.items() if worker.is_placed()}
        ended = {name for name in placed if self._workers[name].has_ended()}
        problems = {name: self._workers[name].problem() for name in ended}
        return ray_link.ClusterStatus(
            machines=machines,
            placed=tuple(sorted(placed - ended)),
            unplaced=tuple(sorted(self._workers.keys() - placed)),
            refused={name: problem for name, problem in problems.items() if problem},
        )

    def dismiss(self) -> None:
        """End all workers; wait first for those that leave by themselves."""
        import ray

        if self._workers:
            runs = [worker.run for worker in self._workers.values()]
            ray.wait(runs, num_returns=len(runs), timeout=GOODBYE_S)
        for worker in self._workers.values():
            _end_actor(worker)
        self._workers.clear()


def _end_actor(worker: RayWorker) -> None:
    """End an actor for good: Ray does not start it again."""
    import ray

    ray.kill(worker.actor, no_restart=True)


SAY_EVERY_S = 0.5


Say = Callable[[msgspec.Struct], None]


def main() -> NoReturn:
    """Serve until the input ends, or until Ray is lost."""
    die_with_parent()
    logs.configure("services")
    say = _take_output()
    with open(sys.stdin.fileno(), "rb", buffering=0, closefd=False) as stream:
        begin = msgspec.json.decode(stream.readline(), type=ray_link.StartRay)
    try:
        serve(
            begin,
            ray_link.PipeReader(sys.stdin.fileno(), msgspec.json.Decoder(ray_link.WantedWorkers)),
            say,
        )
    except ClusterUnavailable as error:
        say(ray_link.ClusterLost(error.problem, error.remedy))
        end_now(ClusterUnavailable.exit_code)
    end_now(0)


def _take_output() -> Say:
    """Return a function that writes to the services; all other output goes to standard error."""
    words = os.dup(sys.stdout.fileno())
    # Ray and other libraries print to standard output, where any line of theirs would break the
    # protocol.
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())

    def say(word: msgspec.Struct) -> None:
        os.write(words, ray_link.encode_line(word))

    return say


def serve(
    begin: ray_link.StartRay, wishes: ray_link.PipeReader[ray_link.WantedWorkers], say: Say
) -> None:
    """Keep the workers that were requested last.

    Raises:
        ClusterUnavailable: Ray cannot be reached, or is lost.
    """
    key = None if begin.key is None else read_worker_key(begin.key, "key")
    cluster = RayCluster(begin.cluster, begin.most, begin.folder)
    workers = RayWorkers(begin.hub, key)
    names: tuple[str, ...] = ()
    while not wishes.ended:
        for wish in wishes.read():
            names = wish.names
        machines = cluster.machines()
        workers.want(names)
        say(workers.standing(machines))
        # This ends early if a request arrives, or if the services have ended and closed the pipe.
        select.select([sys.stdin], [], [], SAY_EVERY_S)
    workers.dismiss()
    cluster.close()


if __name__ == "__main__":
    main()
