"""Who sits where at the hub's table, and who has been silent for longest."""

from collections import OrderedDict

from eigenfail.wire.messages import Hello
from eigenfail_services.hub.seats import Seat


class Seating:
    """Finds seats by connection, by process, and by how long ago somebody was heard.

    Attributes:
        seats: who is here, by their connections.
    """

    def __init__(self) -> None:
        self.seats: dict[bytes, Seat] = {}
        self._by_life: dict[str, bytes] = {}
        self._by_silence: OrderedDict[bytes, None] = OrderedDict()

    def of(self, worker: bytes, hello: Hello) -> list[bytes]:
        """The connections by which somebody who says hello has a seat already."""
        known = {worker, self._by_life.get(hello.life, worker)}
        return [each for each in known if each in self.seats]

    def sit(self, worker: bytes, hello: Hello, now_s: float) -> None:
        """Somebody who has no seat sits down."""
        self.seats[worker] = Seat(hello, now_s)
        self._by_silence[worker] = None
        if hello.life:
            self._by_life[hello.life] = worker

    def heard(self, worker: bytes, now_s: float) -> Seat | None:
        """Somebody was heard; None if they have no seat."""
        if seat := self.seats.get(worker):
            seat.heard_s = now_s
            self._by_silence.move_to_end(worker)
        return seat

    def silent(self, now_s: float, limit_s: float) -> list[bytes]:
        """Those who were not heard for longer than the limit: they are at the front."""
        found = []
        for worker in self._by_silence:
            if now_s - self.seats[worker].heard_s <= limit_s:
                break
            found.append(worker)
        return found

    def excuse(self, away_s: float, now_s: float) -> None:
        """Nobody could be heard for a while: that is not their silence."""
        for seat in self.seats.values():
            seat.heard_s = min(now_s, seat.heard_s + away_s)

    def leave(self, worker: bytes) -> Seat | None:
        """Somebody goes; None if they had no seat."""
        if seat := self.seats.pop(worker, None):
            del self._by_silence[worker]
            if self._by_life.get(seat.life) == worker:
                del self._by_life[seat.life]
        return seat
