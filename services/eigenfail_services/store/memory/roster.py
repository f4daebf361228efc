"""Which workers are there, and were, in memory."""

from collections.abc import Collection, Sequence

from msgspec.structs import asdict, replace

from eigenfail.values.worker import Arrival, Presence
from eigenfail_services.store import limits
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.memory.tables import Tables


class MemoryRoster:
    """Keeps the newest arrivals; older ones are forgotten."""

    def __init__(self, tables: Tables) -> None:
        self._tables = tables
        self._presences: dict[int, Presence] = {}
        self._last = 0

    def arrived(self, arrivals: Sequence[Arrival]) -> list[int]:
        """Workers have come; the numbers under which they are there, rising, in the same order."""
        with self._tables.lock:
            return [self._arrived(arrival) for arrival in arrivals]

    def _arrived(self, arrival: Arrival) -> int:
        self._last += 1
        at_ms = now_ms()
        self._presences[self._last] = Presence(
            **asdict(arrival), id=self._last, arrived_ms=at_ms, heard_ms=at_ms
        )
        self._presences.pop(self._last - limits.KEPT_ARRIVALS, None)
        return self._last

    def heard(self, presences: Collection[int]) -> None:
        """These are still there."""
        with self._tables.lock:
            for number in self._presences.keys() & set(presences):
                self._presences[number] = replace(self._presences[number], heard_ms=now_ms())

    def left(self, presences: Collection[int]) -> None:
        """They are not there any more; a second time changes nothing."""
        with self._tables.lock:
            for number in self._presences.keys() & set(presences):
                if (seen := self._presences[number]).left_ms is None:
                    self._presences[number] = replace(seen, left_ms=now_ms())

    def present(self, since_ms: int) -> tuple[Presence, ...]:
        """Those that were heard since then and have not left, by name."""
        with self._tables.lock:
            known = [*self._presences.values()]
        here = [each for each in known if each.heard_ms >= since_ms and each.left_ms is None]
        return tuple(sorted(here, key=lambda each: (each.worker, each.id)))

    def last(self, worker: str, at_ms: int) -> Presence | None:
        """The latest arrival under a name up to a moment, if it is still known."""
        with self._tables.lock:
            known = [*self._presences.values()]
        named = [each for each in known if each.worker == worker and each.arrived_ms <= at_ms]
        return named[-1] if named else None
