"""The worker as Ray sees it. Ray places it and starts it again; it is never asked what happened."""

from eigenfail.wire.curve import WorkerKey
from eigenfail_workers.worker.parent import Parent


class WorkerActor:
    """Made into a Ray actor by whoever launches it."""

    def run(self, address: str, name: str, key: WorkerKey | None = None) -> None:
        """Serve the hub at the address until it says goodbye; show it the key, if there is one."""
        Parent(address, name, key=key).serve()
