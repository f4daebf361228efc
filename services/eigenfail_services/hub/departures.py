"""Workers that are needed no longer: they finish what they hold, and then they are sent home."""

from collections.abc import Collection, Iterator

from eigenfail_services.hub.seats import Seat

SAY_AGAIN_S = 30.0
"""A goodbye may go astray. A worker that got it leaves within ten seconds."""


class Departures:
    """Who is to leave, by name, and when each was told."""

    def __init__(self) -> None:
        self._names: frozenset[str] = frozenset()
        self._told_s: dict[Seat, float] = {}

    def name(self, names: Collection[str]) -> None:
        """From now on these are to leave, and nobody else; any thread may say so."""
        self._names = frozenset(names)

    def leaving(self, seats: dict[bytes, Seat]) -> list[bytes]:
        """Their connections: they are to get nothing more."""
        names = self._names
        return [worker for worker, seat in seats.items() if seat.name in names] if names else []

    def ready(
        self, leaving: list[bytes], seats: dict[bytes, Seat], now_s: float
    ) -> Iterator[bytes]:
        """Those of them that hold nothing, and were not told lately: they are told now.

        Args:
            leaving: those who are.
            seats: everybody's.
            now_s: of a clock that only ever grows. [s]
        """
        there = {seats[worker] for worker in leaving}
        self._told_s = {seat: at_s for seat, at_s in self._told_s.items() if seat in there}
        for worker in leaving:
            seat = seats[worker]
            if not seat.held and now_s - self._told_s.get(seat, -SAY_AGAIN_S) >= SAY_AGAIN_S:
                self._told_s[seat] = now_s
                yield worker
