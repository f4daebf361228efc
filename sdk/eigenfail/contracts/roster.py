"""What is asked of the list of workers."""

from collections.abc import Collection
from typing import Protocol

from eigenfail.values.worker import Arrival, Presence


class Roster(Protocol):
    """Which workers are there, and were; the newest are kept."""

    def arrived(self, arrival: Arrival) -> int:
        """A worker has come; the number under which it is there."""

    def heard(self, presences: Collection[int]) -> None:
        """These are still there."""

    def left(self, presence: int) -> None:
        """It is not there any more; a second time changes nothing."""

    def present(self, since_ms: int) -> tuple[Presence, ...]:
        """Those that were heard since then and have not left, by name."""

    def last(self, worker: str, at_ms: int) -> Presence | None:
        """The latest arrival under a name up to a moment, if it is still known."""
