"""What happened, for whoever follows."""

from collections.abc import Collection
from typing import Protocol

from eigenfail.values import Event


class EventLog(Protocol):
    """What happened, in order, for whoever follows."""

    def append(self, kind: str, message: str, campaign: int | None = None) -> Event:
        """Log an event."""

    def after(self, event: int, limit: int, campaign: int | None = None) -> list[Event]:
        """Events with ids above `event`, oldest first."""

    def latest(self, limit: int, campaign: int | None = None) -> list[Event]:
        """The newest events, newest first."""

    def newest(self, kinds: Collection[str]) -> list[Event]:
        """The newest event of these kinds of each campaign that is running, by campaign."""

    def last(self) -> int:
        """The id of the newest event, 0 if there is none."""
