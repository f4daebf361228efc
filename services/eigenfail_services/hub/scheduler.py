"""Scheduling: the choice of the next worker, campaign and number of episodes for a lease."""

from collections.abc import Collection
from heapq import heapify, heappop, heappush
from itertools import count
from math import ceil, inf

import msgspec

from eigenfail.values.episode import EpisodeTask
from eigenfail_services.hub import worker_table

NORMAL = 1.0
"""Weight of a campaign that was given none."""

UNKNOWN_EPISODE_S = 0.1
"""Estimated duration of an episode until the first result of its campaign."""

SHORTEST_EPISODE_S = 1e-4
LONGEST_EPISODE_S = 3_600.0
"""Bounds of a duration: a worker that reports nonsense must not distort the estimates."""

SMOOTHING = 0.2

MAX_STALE_ENTRIES = 64
"""Number of stale entries in the heap that are not worth rebuilding it."""

Entry = tuple[float, int, bytes]
"""Load of a worker [s], a running number that orders equal loads by age, and the worker."""


class FairShare:
    """Start-time fair queueing of the campaigns, which share worker time by their weights.

    Goyal, Vin and Cheng: Start-time Fair Queuing, IEEE/ACM Transactions on Networking 5(5), 1997.
    Each campaign has a clock that advances by the worker seconds it is given ÷ its weight, and the
    campaign whose clock is furthest behind has the next turn. The estimated work of a turn is
    charged in advance.

    With turns of at most L_i worker seconds and weights w_i, for campaigns that always have work:

    - two clocks are never further apart than the largest L_k ÷ w_k; so the time that a campaign was
      given never differs from its weight's share of all time by more than w_i × max L_k ÷ w_k
      worker seconds;
    - between two turns of a campaign the others are given at most sum over j of w_j L_i ÷ w_i +
      L_j; with equal turns these are at most sum over j of floor(w_j ÷ w_i) + 1 turns;
    - a new campaign, or a campaign that was idle, waits for at most one turn of each other one.
    """

    def __init__(self) -> None:
        self._weights: dict[int, float] = {}
        self._clocks_s: dict[int, float] = {}
        self._had_work: frozenset[int] = frozenset()
        self._now_s = 0.0

    def set_weight(self, campaign: int, weight: float) -> None:
        """Set the weight of a campaign, which is above 0."""
        self._weights[campaign] = weight

    def next_campaign(self, campaigns: Collection[int]) -> int | None:
        """Return the campaign whose turn it is among those with waiting work.

        A campaign without work at the last turn does not start behind that turn's clock: idle time
        is not saved up.
        """
        if not campaigns:
            return None
        for campaign in set(campaigns) - self._had_work:
            self._clocks_s[campaign] = max(self._now_s, self._clocks_s.get(campaign, 0.0))
        self._had_work = frozenset(campaigns)
        # Of equal clocks the older campaign, by its id.
        chosen = min(campaigns, key=lambda campaign: (self._clocks_s[campaign], campaign))
        self._now_s = self._clocks_s[chosen]
        return chosen

    def charge(self, campaign: int, worker_s: float) -> None:
        """Charge a campaign worker seconds; negative ones correct an estimate or refund a lease."""
        advance_s = worker_s / self._weights.get(campaign, NORMAL)
        self._clocks_s[campaign] = self._clocks_s.get(campaign, self._now_s) + advance_s

    def remove(self, campaign: int) -> None:
        """Remove a campaign that is over."""
        self._had_work -= {campaign}
        self._weights.pop(campaign, None)
        self._clocks_s.pop(campaign, None)


class LeastLoaded:
    """Heap of the workers that need work, the least loaded first.

    An outdated entry stays in the heap until it comes up or until more than half of the entries are
    outdated. A change costs O(log n) on average.
    """

    def __init__(self) -> None:
        self._entries: dict[bytes, Entry] = {}
        self._heap: list[Entry] = []
        self._numbers = count()

    def put(self, worker: bytes, load_s: float) -> None:
        """Add a worker that needs work, or change its load."""
        entry = self._entries[worker] = (load_s, next(self._numbers), worker)
        heappush(self._heap, entry)
        if len(self._heap) > 2 * len(self._entries) + MAX_STALE_ENTRIES:
            self._heap = [*self._entries.values()]
            heapify(self._heap)

    def remove(self, worker: bytes) -> None:
        """Remove a worker that has enough work or has left."""
        self._entries.pop(worker, None)

    def first(self) -> Entry | None:
        """Return the least loaded entry, the oldest among equal ones; None if the heap is empty."""
        while self._heap and self._entries.get(self._heap[0][2]) is not self._heap[0]:
            heappop(self._heap)
        return self._heap[0] if self._heap else None


class DurationEstimates:
    """Smoothed duration of an episode of each campaign, from the durations that results report."""

    def __init__(self) -> None:
        self._estimates_s: dict[int, float] = {}

    def update(self, campaign: int, wall_s: float) -> None:
        """Learn from the duration of an episode."""
        estimate_s = self._estimates_s.get(campaign, wall_s)
        self._estimates_s[campaign] = estimate_s + SMOOTHING * (wall_s - estimate_s)

    def episode_s(self, campaign: int) -> float:
        """Return the estimated duration of an episode. [s]"""
        estimate_s = self._estimates_s.get(campaign, UNKNOWN_EPISODE_S)
        return max(estimate_s, SHORTEST_EPISODE_S)

    def remove(self, campaign: int) -> None:
        """Remove a campaign that is over."""
        self._estimates_s.pop(campaign, None)


class Assignment(msgspec.Struct, frozen=True, eq=False):
    """Episodes of a campaign that a worker is to run."""

    worker: bytes
    campaign: int
    tasks: tuple[EpisodeTask, ...]


class _Pool:
    """Workers that can run the same campaigns, and the shares of their time."""

    def __init__(self) -> None:
        self.workers: set[bytes] = set()
        self.needing_work = LeastLoaded()
        self.shares = FairShare()


class Scheduler:
    """Keeps the workers busy, and the campaigns' shares of worker time fair.

    All campaigns share the time of workers with a bridge. Campaigns that need no bridge share the
    time of workers without one. Each of the two pools is shared on its own, so that no campaign
    waits for a turn on workers that cannot run it. An assignment costs O(log workers + campaigns),
    however many episodes are leased or wait.
    """

    def __init__(self) -> None:
        self._durations = DurationEstimates()
        self._pools = {False: _Pool(), True: _Pool()}
        self._on_bridge: set[int] = set()
        # Between two assignments a worker changes hundreds of times, and its load counts once.
        self._changed: dict[bytes, worker_table.WorkerSession] = {}

    def set_weight(self, campaign: int, weight: float) -> None:
        """Set the weight of a campaign's share."""
        for pool in self._pools.values():
            pool.shares.set_weight(campaign, weight)

    def require_bridge(self, campaign: int) -> None:
        """Assign the episodes of a campaign only to workers with a bridge."""
        self._on_bridge.add(campaign)

    def list_unrunnable(self, campaigns: Collection[int]) -> Collection[int]:
        """Return the given campaigns that no connected worker can run."""
        return () if self.has_bridge() else self._on_bridge.intersection(campaigns)

    def has_bridge(self) -> bool:
        """Return whether a worker with a bridge is connected."""
        return bool(self._pools[True].workers)

    def episode_s(self, campaign: int) -> float:
        """Return the estimated duration of an episode at a usual worker. [s]"""
        return self._durations.episode_s(campaign)

    def estimate_work_s(self, campaign: int, session: worker_table.WorkerSession) -> float:
        """Return the estimated duration of an episode at this worker. [s]"""
        return self._durations.episode_s(campaign) * session.slowness

    def update_worker(self, worker: bytes, session: worker_table.WorkerSession) -> None:
        """Note a change of what a worker holds or runs in parallel."""
        self._pools[session.has_bridge].workers.add(worker)
        self._changed[worker] = session

    def _update_loads(self) -> None:
        for worker, session in self._changed.items():
            needing_work = self._pools[session.has_bridge].needing_work
            if session.needs_work():
                needing_work.put(worker, session.load_s / session.parallel)
            else:
                needing_work.remove(worker)
        self._changed.clear()

    def remove_worker(self, worker: bytes, session: worker_table.WorkerSession) -> None:
        """Assign nothing more to a worker."""
        # Otherwise the next update of the loads would put it back.
        self._changed.pop(worker, None)
        pool = self._pools[session.has_bridge]
        pool.workers.discard(worker)
        pool.needing_work.remove(worker)

    def charge(self, campaign: int, session: worker_table.WorkerSession, work_s: float) -> None:
        """Charge a campaign worker seconds; negative ones for episodes that come back unfinished.

        Args:
            campaign: campaign to be charged.
            session: session of the worker whose time it is.
            work_s: worker seconds.
        """
        self._pools[session.has_bridge].shares.charge(campaign, work_s)

    def record_duration(
        self, campaign: int, wall_s: float, lease: worker_table.EndedLease | None
    ) -> None:
        """Learn from the duration of an episode.

        Args:
            campaign: campaign of the episode.
            wall_s: duration that its result reports, which may be nonsense. [s]
            lease: lease under which it was run; None if the worker's lease had ended.
        """
        if not 0.0 < wall_s < inf:
            return
        duration_s = min(wall_s, LONGEST_EPISODE_S)
        self._durations.update(campaign, duration_s)
        if lease is not None:
            lease.session.update_slowness(duration_s / self._durations.episode_s(campaign))
            self.charge(campaign, lease.session, duration_s - lease.work_s)

    def remove_campaign(self, campaign: int) -> None:
        """Remove a campaign that is over."""
        self._durations.remove(campaign)
        self._on_bridge.discard(campaign)
        for pool in self._pools.values():
            pool.shares.remove(campaign)

    def assign_next(
        self, sessions: dict[bytes, worker_table.WorkerSession], queue: worker_table.EpisodeQueue
    ) -> Assignment | None:
        """Take the next assignment from the queue; None if no worker needs work that it can run."""
        self._update_loads()
        # A pool whose workers can run nothing that waits must not keep the other pool from its
        # turn.
        served = [pool for pool in self._pools.values() if self._campaigns_for(pool, queue)]
        entries = [entry for pool in served if (entry := pool.needing_work.first()) is not None]
        if not entries:
            return None
        # Of two equally loaded workers, the one without a bridge comes first in `entries`.
        _, _, worker = min(entries, key=lambda entry: entry[0])
        session = sessions[worker]
        pool = self._pools[session.has_bridge]
        campaigns = self._campaigns_for(pool, queue)
        campaign = pool.shares.next_campaign(campaigns)
        if campaign is None:
            return None
        work_s = self.estimate_work_s(campaign, session)
        # Long episodes are leased one at a time. Of short ones each waiting campaign gets its
        # part of the worker's room, so that campaigns alternate at a worker within seconds.
        room = (
            1
            if work_s >= worker_table.LONG_EPISODE_S
            else ceil(session.room_s / len(campaigns) / work_s)
        )
        able = len(self._pools[True].workers if campaign in self._on_bridge else sessions)
        # The last episodes of a campaign are spread over the workers, so that they end together.
        spread = ceil(len(queue.tasks(campaign)) / (2 * able))
        credit = session.credit - len(session.held)
        episodes = max(1, min(max(room, session.slots(campaign)), spread, credit))
        tasks = tuple(queue.pop(campaign) for _ in range(episodes))
        return Assignment(worker, campaign, tasks)

    def _campaigns_for(self, pool: _Pool, queue: worker_table.EpisodeQueue) -> Collection[int]:
        """Return the campaigns with waiting episodes that the workers of a pool can run."""
        campaigns = queue.list_waiting_campaigns()
        if pool is self._pools[True] or not self._on_bridge:
            return campaigns
        return [campaign for campaign in campaigns if campaign not in self._on_bridge]
