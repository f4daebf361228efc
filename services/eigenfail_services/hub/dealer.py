"""Who gets how many episodes of which campaign next."""

from math import ceil
from typing import NamedTuple

from eigenfail_services.hub.hunger import Hungry
from eigenfail_services.hub.paces import Paces, told
from eigenfail_services.hub.seats import Seat
from eigenfail_services.hub.shares import Shares
from eigenfail_services.hub.waiting import Waiting


class Portion(NamedTuple):
    """So many episodes of a campaign, for a worker."""

    worker: bytes
    campaign: int
    episodes: int


class Dealer:
    """Keeps the workers at work, and the campaigns' shares of their time fair.

    A portion costs O(log workers + campaigns), however much is leased or waits.
    """

    def __init__(self) -> None:
        self._paces = Paces()
        self._shares = Shares()
        self._hungry = Hungry()

    def weigh(self, campaign: int, weight: float) -> None:
        """From now on a campaign's share goes by this weight."""
        self._shares.weigh(campaign, weight)

    def pace_s(self, campaign: int) -> float:
        """What an episode is thought to take of a worker."""
        return self._paces.of(campaign)

    def look(self, worker: bytes, seat: Seat) -> None:
        """What somebody holds has changed."""
        if seat.is_hungry():
            self._hungry.put(worker, seat.load_s)
        else:
            self._hungry.drop(worker)

    def leave(self, worker: bytes) -> None:
        """Somebody goes."""
        self._hungry.drop(worker)

    def lent(self, campaign: int, work_s: float) -> None:
        """Work of a campaign went to a worker; below 0, it came back undone."""
        self._shares.charge(campaign, work_s)

    def took(self, campaign: int, wall_s: float, thought_s: float | None) -> None:
        """A result came: an episode took so long, and was lent as what was thought."""
        if (took_s := told(wall_s)) is None:
            return
        self._paces.learn(campaign, took_s)
        if thought_s is not None:
            self._shares.charge(campaign, took_s - thought_s)

    def forget(self, campaign: int) -> None:
        """It is over."""
        self._paces.forget(campaign)
        self._shares.forget(campaign)

    def next(self, seats: dict[bytes, Seat], waiting: Waiting) -> Portion | None:
        """What goes out now; None if nothing waits, or nobody should hold more."""
        worker = self._hungry.first()
        if worker is None:
            return None
        campaigns = waiting.campaigns()
        campaign = self._shares.next(campaigns)
        if campaign is None:
            return None
        seat = seats[worker]
        room = ceil(seat.room_s / len(campaigns) / self._paces.of(campaign))
        share = ceil(len(waiting.of(campaign)) / (2 * len(seats)))  # the last ones are spread
        episodes = max(1, min(room, share, seat.credit - len(seat.held)))
        return Portion(worker, campaign, episodes)
