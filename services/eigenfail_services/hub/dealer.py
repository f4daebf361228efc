"""Who gets how many episodes of which campaign next."""

from collections.abc import Collection
from math import ceil
from typing import NamedTuple

import msgspec

from eigenfail.values import EpisodeTask
from eigenfail_services.hub.hunger import Hungry
from eigenfail_services.hub.paces import Paces, told
from eigenfail_services.hub.seats import Loan, Seat
from eigenfail_services.hub.shares import Shares
from eigenfail_services.hub.waiting import Waiting


class Portion(NamedTuple):
    """So many episodes of a campaign, for a worker."""

    worker: bytes
    campaign: int
    episodes: int


class Assignment(msgspec.Struct, frozen=True, eq=False):
    """These episodes go to this worker."""

    worker: bytes
    campaign: int
    tasks: tuple[EpisodeTask, ...]


class Pool:
    """Workers that can run the same campaigns, which share their time; those that are hungry."""

    def __init__(self) -> None:
        self.workers: set[bytes] = set()
        self.hungry = Hungry()
        self.shares = Shares()


class Dealer:
    """Keeps the workers at work, and the campaigns' shares of their time fair.

    The time of workers with a bridge is shared by all campaigns, that of the others by those that
    need none: each of the two as if the other was not there, so that nobody waits for workers that
    cannot run it. A portion costs O(log workers + campaigns), however much is leased or waits.
    """

    def __init__(self) -> None:
        self._paces = Paces()
        self._pools = {False: Pool(), True: Pool()}
        self._on_bridge: set[int] = set()

    def weigh(self, campaign: int, weight: float) -> None:
        """From now on a campaign's share goes by this weight."""
        for pool in self._pools.values():
            pool.shares.weigh(campaign, weight)

    def need_bridge(self, campaign: int) -> None:
        """Only who has a bridge can run it."""
        self._on_bridge.add(campaign)

    def stranded(self, waiting: Collection[int]) -> Collection[int]:
        """Those of the campaigns that nobody who is here can run."""
        return () if self.has_bridge() else self._on_bridge.intersection(waiting)

    def has_bridge(self) -> bool:
        """Whether anybody who is here has one."""
        return bool(self._pools[True].workers)

    def pace_s(self, campaign: int) -> float:
        """What an episode is thought to take of a worker."""
        return self._paces.of(campaign)

    def work_s(self, campaign: int, seat: Seat) -> float:
        """What an episode is thought to take of this worker."""
        return self._paces.of(campaign) * seat.slowness

    def look(self, worker: bytes, seat: Seat) -> None:
        """What somebody holds, or runs side by side, has changed."""
        pool = self._pools[seat.bridge]
        pool.workers.add(worker)
        if seat.is_hungry():
            pool.hungry.put(worker, seat.load_s / seat.beside)
        else:
            pool.hungry.drop(worker)

    def leave(self, worker: bytes, seat: Seat) -> None:
        """Somebody goes."""
        pool = self._pools[seat.bridge]
        pool.workers.discard(worker)
        pool.hungry.drop(worker)

    def lent(self, campaign: int, seat: Seat, work_s: float) -> None:
        """Work of a campaign went to a worker; below 0, it came back undone."""
        self._pools[seat.bridge].shares.charge(campaign, work_s)

    def took(self, campaign: int, wall_s: float, loan: Loan | None) -> None:
        """A result came: an episode took so long; None if who brought it held it no more."""
        if (took_s := told(wall_s)) is None:
            return
        self._paces.learn(campaign, took_s)
        if loan is not None:
            loan.seat.learn(took_s / self._paces.of(campaign))
            self.lent(campaign, loan.seat, took_s - loan.work_s)

    def forget(self, campaign: int) -> None:
        """It is over."""
        self._paces.forget(campaign)
        self._on_bridge.discard(campaign)
        for pool in self._pools.values():
            pool.shares.forget(campaign)

    def next(self, seats: dict[bytes, Seat], waiting: Waiting) -> Portion | None:
        """What goes out now; None if nothing waits for who is here, or nobody should hold more."""
        served = [pool for pool in self._pools.values() if self._for(pool, waiting)]
        hungry = [first for pool in served if (first := pool.hungry.first()) is not None]
        if not hungry:
            return None
        _, _, worker = min(hungry, key=lambda entry: entry[0])  # of equals, one without a bridge
        seat = seats[worker]
        pool = self._pools[seat.bridge]
        campaigns = self._for(pool, waiting)
        campaign = pool.shares.next(campaigns)
        if campaign is None:
            return None
        room = ceil(seat.room_s / len(campaigns) / self.work_s(campaign, seat))
        able = len(self._pools[True].workers if campaign in self._on_bridge else seats)
        share = ceil(len(waiting.of(campaign)) / (2 * able))  # the last ones are spread
        wanted = min(max(room, seat.slots(campaign)), share, seat.credit - len(seat.held))
        return Portion(worker, campaign, max(1, wanted))

    def _for(self, pool: Pool, waiting: Waiting) -> Collection[int]:
        """Campaigns of which something waits that those in a pool can run."""
        campaigns = waiting.campaigns()
        if pool is self._pools[True] or not self._on_bridge:
            return campaigns
        return [campaign for campaign in campaigns if campaign not in self._on_bridge]
