"""Workers as Ray actors. Ray places them and starts them again; it is never asked what they did."""

from collections.abc import Collection
from typing import Any

from eigenfail import plugins
from eigenfail.wire.curve import WorkerKey
from eigenfail_services.campaigns.launching.ray_words import Standing

GOODBYE_S = 3.0


class RayWorker:
    """One actor, and what it was asked: where it is, and to work until it is sent home."""

    def __init__(self, actor: Any, hub: str, name: str, key: WorkerKey | None) -> None:
        self.actor = actor
        self.placed = actor.place.remote()
        self.run = actor.run.remote(hub, name, key)

    def is_placed(self) -> bool:
        """Whether Ray has found a place for it."""
        return is_there(self.placed)

    def has_ended(self) -> bool:
        """Whether it went home, or ended for good."""
        return is_there(self.run)

    def problem(self) -> str:
        """Why it ended, if nobody sent it home."""
        import ray

        try:
            ray.get(self.run)
        except (ray.exceptions.RayError, Exception) as error:  # noqa: BLE001 - the worker's own, through Ray
            return str(error).strip().splitlines()[-1]
        return ""


def is_there(reference: Any) -> bool:
    """Whether an answer has come, or none ever will."""
    import ray

    return bool(ray.wait([reference], timeout=0)[0])


class RayWorkers:
    """As many as are wanted, by name.

    Args:
        hub: the address that they connect to.
        key: what they show there.
    """

    def __init__(self, hub: str, key: WorkerKey | None = None) -> None:
        import ray

        actor = plugins.load(plugins.WORKER_ACTORS, "ray")
        # Ray starts a dead worker again and calls its `run` anew; the hub leases to it afresh.
        self._remote = ray.remote(num_cpus=1, max_restarts=-1, max_task_retries=-1)(actor)
        self._told = hub, key
        self._workers: dict[str, RayWorker] = {}

    def want(self, names: Collection[str]) -> None:
        """Ask for those that are new; end those not wanted that went home, or have no place yet.

        Others that are not wanted are at work until the hub sends them home.
        """
        for name in names:
            if name not in self._workers:
                hub, key = self._told
                self._workers[name] = RayWorker(self._remote.remote(), hub, name, key)
        for name in self._workers.keys() - set(names):
            worker = self._workers[name]
            if worker.has_ended() or not worker.is_placed():
                end(self._workers.pop(name))

    def standing(self, machines: int) -> Standing:
        """Who has a place, who has none, and who gave up."""
        placed = {name for name, worker in self._workers.items() if worker.is_placed()}
        ended = {name for name in placed if self._workers[name].has_ended()}
        problems = {name: self._workers[name].problem() for name in ended}
        return Standing(
            machines=machines,
            placed=tuple(sorted(placed - ended)),
            unplaced=tuple(sorted(self._workers.keys() - placed)),
            refused={name: problem for name, problem in problems.items() if problem},
        )

    def dismiss(self) -> None:
        """End all, those first that leave by themselves."""
        import ray

        if self._workers:
            runs = [worker.run for worker in self._workers.values()]
            ray.wait(runs, num_returns=len(runs), timeout=GOODBYE_S)
        for worker in self._workers.values():
            end(worker)
        self._workers.clear()


def end(worker: RayWorker) -> None:
    """For good: Ray does not start it again."""
    import ray

    ray.kill(worker.actor, no_restart=True)
