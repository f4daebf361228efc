"""What the services ask of whoever starts their workers."""

from collections.abc import Callable, Collection, Sequence
from typing import Protocol

import msgspec

from eigenfail.wire.curve import WorkerKey
from eigenfail_services.hub.muster import Muster


class Notice(msgspec.Struct, frozen=True):
    """Something that whoever waits for workers should know; an event of this kind."""

    kind: str
    message: str


def never() -> bool:
    """Nobody asks for an end."""
    return False


class Table(Protocol):
    """Where workers sit down: the hub."""

    def muster(self) -> Muster:
        """What there is to do, and who is there."""

    def part_with(self, names: Collection[str]) -> None:
        """Lease nothing more to these workers, and send each home once it holds nothing."""


class Launcher(Protocol):
    """Starts workers somewhere, and takes them down again."""

    def start(
        self, hub: str, key: WorkerKey | None = None, given_up: Callable[[], bool] = never
    ) -> None:
        """Have workers connect to the hub, with a key where it asks for one.

        Args:
            hub: its address.
            key: what workers show there.
            given_up: whether nobody waits for it any more: then it returns, with nothing started.

        Raises:
            ClusterUnavailable: there is nowhere to start them.
        """

    def tend(self, table: Table) -> Sequence[Notice]:
        """See that there are as many as the work needs; never waits. What there is to say of it."""

    def stop(self) -> None:
        """Wait for those that were sent home, and end the rest."""


class NoLauncher:
    """For workers that are started by hand."""

    def start(
        self, hub: str, key: WorkerKey | None = None, given_up: Callable[[], bool] = never
    ) -> None:
        """Nothing to do."""

    def tend(self, _table: Table) -> Sequence[Notice]:
        """Nothing to do, and nothing to say."""
        return ()

    def stop(self) -> None:
        """Nothing to do."""
