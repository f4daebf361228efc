"""Writes down who is there: arrivals and ends soon after, and that the others stay."""

import time
from collections.abc import Mapping

from eigenfail.contracts import Roster
from eigenfail_services.hub.seats import Seat

LOOK_EVERY_S = 1.0
TELL_EVERY_S = 5.0


class Attendance:
    """Holds the table against what was written down about it.

    Args:
        roster: where it is written.
        seats: who is here, by their connections.
    """

    def __init__(self, roster: Roster, seats: Mapping[bytes, Seat]) -> None:
        self._roster = roster
        self._seats = seats
        self._numbers: dict[Seat, int] = {}
        self._look_s = self._tell_s = time.monotonic()

    def note(self) -> None:
        """Write down what has changed, if it is time to.

        Raises:
            StoreUnavailable: it could not be; the next call goes on with it.
        """
        now_s = time.monotonic()
        if now_s < self._look_s:
            return
        self._arrivals()
        self._ends()
        if now_s >= self._tell_s and self._numbers:
            self._roster.heard(self._numbers.values())
            self._tell_s = now_s + TELL_EVERY_S
        self._look_s = now_s + LOOK_EVERY_S

    def _arrivals(self) -> None:
        seats = [seat for seat in self._seats.values() if seat not in self._numbers]
        if seats:
            numbers = self._roster.arrived([seat.arrival for seat in seats])
            self._numbers.update(zip(seats, numbers, strict=True))

    def _ends(self) -> None:
        gone = self._numbers.keys() - {*self._seats.values()}
        if gone:
            self._roster.left([self._numbers[seat] for seat in gone])
            for seat in gone:
                del self._numbers[seat]

    def close(self) -> None:
        """Nobody is here any more.

        Raises:
            StoreUnavailable: it could not be written down.
        """
        if self._numbers:
            self._roster.left(self._numbers.values())
        self._numbers.clear()
