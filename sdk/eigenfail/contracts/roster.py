"""What is asked of the list of workers."""

from collections.abc import Collection, Sequence
from typing import Protocol

from eigenfail.values.worker import Arrival, Presence


class Roster(Protocol):
    """Which workers are there, and were; the newest are kept.

    Whatever is written down at a time is written all or nothing.
    """

    def arrived(self, arrivals: Sequence[Arrival]) -> list[int]:
        """Workers have come; the numbers under which they are there, rising, in the same order."""

    def heard(self, presences: Collection[int]) -> None:
        """These are still there."""

    def left(self, presences: Collection[int]) -> None:
        """They are not there any more; a second time changes nothing."""

    def present(self, since_ms: int) -> tuple[Presence, ...]:
        """Those that were heard since then and have not left, by name."""

    def last(self, worker: str, at_ms: int) -> Presence | None:
        """The latest arrival under a name up to a moment, if it is still known."""
